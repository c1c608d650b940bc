"""Shape measures on shapes with known values."""

import dataclasses as dc
import json

import numpy as np
import pytest

from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.measures import (
    coverage,
    height_map,
    largest_height,
    measure,
    overstretch,
)
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.testing.table import TABLE


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    return Cloth(outline("towel", 49), load_material("terry"), TABLE)


def moved(cloth: Cloth, offset: np.ndarray) -> ClothState:
    state = cloth.flat((0.0, -1.1))
    return dc.replace(state, positions=state.positions + offset)


def test_a_flat_towel_covers_itself(cloth: Cloth) -> None:
    truth = measure(cloth, cloth.flat((0.003, -1.1), yaw=0.2))
    assert abs(truth.coverage - 1.0) < 0.003
    assert abs(truth.height) < 1e-12
    assert truth.above_5mm == 0.0
    assert abs(truth.overstretch) < 1e-9
    assert json.loads(json.dumps(truth.to_json())) == truth.to_json()


def test_a_folded_towel_covers_half(cloth: Cloth) -> None:
    state = cloth.flat((0.0, -1.1))
    positions = state.positions.copy()
    positions[0] = np.abs(positions[0])
    assert abs(coverage(cloth, dc.replace(state, positions=positions)) - 0.5) < 0.005


def test_the_height_map_is_where_it_says(cloth: Cloth) -> None:
    state = cloth.flat((0.0, -1.1))
    slope = 0.05 * (state.positions[0] + 0.24) + 0.02 * (state.positions[1] + 1.34)
    tilted = dc.replace(
        state, positions=state.positions + np.array([0.0, 0.0, 1.0])[:, None] * slope
    )
    heights, origin = height_map(cloth, tilted, 0.004)
    rows, columns = np.nonzero(np.isfinite(heights))
    x, y = origin[0] + 0.004 * columns, origin[1] + 0.004 * rows
    expected = 0.05 * (x + 0.24) + 0.02 * (y + 1.34)
    np.testing.assert_allclose(heights[rows, columns], expected, atol=1e-9)
    assert np.abs(x).max() <= 0.24 + 1e-9
    assert np.ptp(y) > 0.47


def test_the_upper_layer_is_seen(cloth: Cloth) -> None:
    state = cloth.flat((0.0, -1.1))
    positions = state.positions.copy()
    positions[2] += np.where(positions[0] > 0.0, 0.02, 0.0)
    positions[0] = np.abs(positions[0])
    heights, _ = height_map(cloth, dc.replace(state, positions=positions), 0.002)
    assert np.nanmedian(heights) == pytest.approx(0.02, abs=1e-9)


def test_height_is_that_of_the_highest_point(cloth: Cloth) -> None:
    bump = np.zeros((3, cloth.size))
    bump[2, 300] = 0.017
    assert largest_height(cloth, moved(cloth, bump)) == pytest.approx(0.017)


def test_overstretch_is_the_worst_piece_of_yarn(cloth: Cloth) -> None:
    state = cloth.flat((0.0, -1.1))
    shift = np.where(np.arange(cloth.size) // 49 >= 20, 0.001, 0.0)
    stretched = dc.replace(
        state, positions=state.positions + np.array([1.0, 0.0, 0.0])[:, None] * shift
    )
    assert overstretch(cloth, stretched) == pytest.approx(0.001 / 0.05)
    shorter = dc.replace(state, positions=state.positions * np.array([[0.9], [0.9], [1.0]]))
    assert overstretch(cloth, shorter) == 0.0


@pytest.mark.parametrize("resolution", [0.0, -1.0, np.nan, 1.0])
def test_a_bad_resolution_is_refused(cloth: Cloth, resolution: float) -> None:
    with pytest.raises(InputError, match="resolution"):
        height_map(cloth, cloth.flat((0.0, -1.1)), resolution)
