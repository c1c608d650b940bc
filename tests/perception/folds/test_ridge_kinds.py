"""Ridges of true wrinkles, of borders of layers and on stacks are told apart."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.flattening.observation import Observation
from unwrinkle.models.garment import rectangle
from unwrinkle.perception.folds.ridge_kinds import RidgeKind
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.testing.folded_garments import folded_map
from unwrinkle.testing.table import TABLE

TOWEL = rectangle("towel", 0.48, 0.48, 0.0025)


def with_ridge(range_map: RangeMap, height: float, sigma: float, length: float) -> RangeMap:
    """Add a ridge along x through the garment's centre, with smooth ends."""
    ny, nx = range_map.shape
    x = range_map.origin[0] + range_map.resolution * np.arange(nx)
    y = range_map.origin[1] + range_map.resolution * np.arange(ny) + 1.10
    ends = 1.0 / (1.0 + np.exp((np.abs(x) - 0.5 * length) / 0.006))
    raised = range_map.height + height * np.exp(-0.5 * (y / sigma) ** 2)[:, None] * ends
    return dc.replace(range_map, height=np.where(range_map.garment, raised, range_map.height))


def kinds(range_map: RangeMap) -> list[RidgeKind]:
    return list(Observation.of(analyse(range_map, table=TABLE)).folds.kinds)


@pytest.mark.parametrize(
    ("sensor", "height", "sigma"), [("stereo", 0.012, 0.009), ("xtion", 0.020, 0.014)]
)
def test_a_ridge_on_the_lowest_cloth_is_a_wrinkle(sensor: str, height: float, sigma: float) -> None:
    found = kinds(with_ridge(folded_map(TOWEL.outline, sensor=sensor), height, sigma, 0.25))
    assert found and found[0] is RidgeKind.WRINKLE


def step_with_lip(sensor: str, step: float, lip: float) -> RangeMap:
    """A layer border along x: the cloth at y > 0 lies higher, with a rounded lip at the border."""
    flat = folded_map(TOWEL.outline, sensor=sensor)
    y = flat.origin[1] + flat.resolution * np.arange(flat.shape[0]) + 1.10
    profile = step / (1.0 + np.exp(-y / 0.002)) + lip * np.exp(-0.5 * ((y - 0.012) / 0.008) ** 2)
    return dc.replace(flat, height=np.where(flat.garment, flat.height + profile[:, None], 0.0))


@pytest.mark.parametrize(
    ("sensor", "step", "lip"), [("stereo", 0.006, 0.006), ("xtion", 0.012, 0.014)]
)
def test_a_lip_on_a_border_is_no_wrinkle(sensor: str, step: float, lip: float) -> None:
    seen = Observation.of(analyse(step_with_lip(sensor, step, lip), table=TABLE))
    assert RidgeKind.WRINKLE not in seen.folds.kinds
    assert all(wrinkle.kind is not RidgeKind.WRINKLE for wrinkle in seen.features.wrinkles)


def test_a_short_ridge_on_a_stack_is_a_bulge() -> None:
    flat = folded_map(TOWEL.outline, sensor="xtion")
    y = flat.origin[1] + flat.resolution * np.arange(flat.shape[0]) + 1.10
    stack = 0.020 / (1.0 + np.exp((np.abs(y) - 0.11) / 0.004))
    height = np.where(flat.garment, flat.height + stack[:, None], 0.0)
    found = kinds(with_ridge(dc.replace(flat, height=height), 0.020, 0.014, 0.06))
    assert RidgeKind.BULGE in found and RidgeKind.WRINKLE not in found


def test_ridges_that_are_no_wrinkles_come_last() -> None:
    seen = Observation.of(
        analyse(with_ridge(step_with_lip("stereo", 0.006, 0.006), 0.0, 1.0, 0.1), table=TABLE)
    )
    order = [kind is RidgeKind.WRINKLE for kind in seen.folds.kinds]
    assert order == sorted(order, reverse=True)
    assert [each.kind for each in seen.features.wrinkles] == list(seen.folds.kinds)
