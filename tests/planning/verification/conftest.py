"""Fixtures of the verification's tests."""

from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.model import CellModel

from .built import resting_plan


@pytest.fixture(scope="session")
def model(cell: Cell) -> CellModel:
    return CellModel(cell)


@pytest.fixture(scope="session")
def target(make_target: Callable[..., FlatteningTarget]) -> FlatteningTarget:
    """Hands at (0.24, -1.1) and (-0.24, -1.1) m, 30 mm to pull outwards each."""
    return make_target((0.0, -1.10), np.pi, half=0.24, pull=0.03)


@pytest.fixture(scope="session")
def rest(cell: Cell, target: FlatteningTarget) -> FlatteningPlan:
    return resting_plan(cell, target)
