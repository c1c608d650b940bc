"""Hole filling: which holes of a surface are filled and which stay open."""

import numpy as np
import pytest

from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.perception.wrinkles.hole_filling import WEIGHT, fill_holes
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import TABLE

RESOLUTION = 0.003


def sloped(shape=(40, 60)):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return (0.01 + 2e-4 * rows - 1e-4 * columns).astype(np.float32)


def test_a_membrane_over_a_plane_is_the_plane():
    height, weight = sloped(), np.ones((40, 60), np.float32)
    weight[10:20, 25:33] = 0.0
    filled, weights = fill_holes(
        np.where(weight > 0, height, 0), weight, np.ones_like(weight, bool), RESOLUTION
    )
    assert np.allclose(filled, height, atol=1e-7)
    assert np.all(weights[10:20, 25:33] == WEIGHT) and weights.min() == WEIGHT


def test_measured_cells_and_wide_holes_stay_as_they_are():
    height, weight = sloped(), np.ones((40, 60), np.float32)
    weight[10:30, 20:40] = 0.0  # 60 mm square
    filled, weights = fill_holes(height, weight, np.ones_like(weight, bool), RESOLUTION)
    assert filled is height and weights is weight


def test_nothing_is_made_up_off_the_garment_or_without_data_around():
    height, weight = sloped(), np.ones((40, 60), np.float32)
    weight[:, 50:] = 0.0
    wanted = np.zeros_like(weight, bool)
    wanted[:, :50] = True
    wanted[5:9, 55:58] = True  # a part of the mask where nothing was measured
    _, weights = fill_holes(height, weight, wanted, RESOLUTION)
    assert not weights[:, 50:].any()


@pytest.mark.parametrize("edge", [0, 39])
def test_a_hole_at_the_border_hangs_on_what_is_there(edge):
    height, weight = np.full((40, 60), 0.02, np.float32), np.ones((40, 60), np.float32)
    rows = slice(0, 4) if edge == 0 else slice(36, 40)
    weight[rows, 30:34] = 0.0
    filled, weights = fill_holes(
        height * (weight > 0), weight, np.ones_like(weight, bool), RESOLUTION
    )
    assert np.allclose(filled, 0.02) and weights[edge, 31] == WEIGHT


def test_a_wrinkle_with_a_hidden_side_stays_in_one_piece():
    ridge = Ridge(centre=(0.0, -1.10), angle=0.1, height=0.02, sigma=0.009, length=0.30)
    towel = Towel(ridges=(ridge,), waviness=0.0)
    x, y = np.meshgrid(-0.3 + 0.001 * np.arange(601), -1.4 + 0.001 * np.arange(601))
    height = towel.height(x, y)
    across = (y + 1.10) * np.cos(0.1) - x * np.sin(0.1)
    hidden = (np.abs(x) < 0.08) & (across > 0.002) & (across < 0.022)

    def seen(valid):
        return RangeMap(
            height=height.astype(np.float32),
            valid=valid,
            garment=towel.edge_distance(x, y) > 0.0,
            resolution=0.001,
            origin=np.array([-0.3, -1.4]),
            table_height=0.7,
            sensor="stereo-head",
        )

    whole = analyse(seen(np.ones(x.shape, bool)), table=TABLE).wrinkles[0]
    partly = analyse(seen(~hidden), table=TABLE).wrinkles[0]
    assert partly.length == pytest.approx(whole.length, abs=0.02)
    assert partly.peak_height == pytest.approx(whole.peak_height, abs=0.003)
    assert partly.pull_distance("foot") == pytest.approx(whole.pull_distance("foot"), rel=0.35)
