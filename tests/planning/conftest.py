"""Fixtures of the planning tests: the cell, its models, and targets made from a few numbers."""

from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.planner import FlatteningPlanner

TargetMaker = Callable[..., FlatteningTarget]


@pytest.fixture(scope="session")
def cell() -> Cell:
    """The shipped Glasgow cell."""
    return load_cell()


@pytest.fixture(scope="session")
def kinematics(cell: Cell) -> Kinematics:
    return Kinematics(cell)


@pytest.fixture(scope="session")
def planner(cell: Cell) -> FlatteningPlanner:
    return FlatteningPlanner(cell)


@pytest.fixture(scope="session")
def make_target() -> TargetMaker:
    """Targets: centre (x, y), wrinkle direction phi from the robot's forward (-y), half distance,
    pull, contour errors.
    """
    from unwrinkle.testing.targets import flattening_task

    def make(
        centre: tuple[float, float] = (0.0, -1.10),
        phi: float = 0.0,
        half: float = 0.24,
        pull: float = 0.03,
        errors: tuple[float, float] = (0.0, 0.0),
    ) -> FlatteningTarget:
        return flattening_task(centre, phi, half=half, pull=pull, errors=errors)

    return make


@pytest.fixture(scope="session")
def random_targets(make_target: TargetMaker) -> Callable[[int, int], list[FlatteningTarget]]:
    """A number of random targets about the default place, from a seed."""

    def targets(count: int, seed: int) -> list[FlatteningTarget]:
        rng = np.random.default_rng(seed)
        return [
            make_target(
                (rng.uniform(-0.1, 0.1), rng.uniform(-1.15, -1.05)),
                rng.uniform(-np.pi / 2, np.pi / 2),
                rng.uniform(0.20, 0.26),
                rng.uniform(0.005, 0.030),
                tuple(np.radians(rng.uniform(-25, 25, 2))),
            )
            for _ in range(count)
        ]

    return targets
