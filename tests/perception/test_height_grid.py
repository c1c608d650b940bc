"""Averaging scattered points into the grid."""

import numpy as np
import pytest

from unwrinkle.perception.height_grid import Grid, average


def test_grid_covers_its_points_on_whole_multiples() -> None:
    grid = Grid.over(np.array([0.0013, 0.0101]), np.array([-1.0, -0.9]), 0.002, 0.004)
    assert grid.x_first <= 0.0013 - 0.004
    assert grid.x_first + (grid.nx - 1) * 0.002 >= 0.0101 + 0.004
    assert grid.y_first / 0.002 == pytest.approx(round(grid.y_first / 0.002))
    with pytest.raises(ValueError, match="too large"):
        Grid.over(np.array([0.0, 100.0]), np.array([0.0, 100.0]), 0.0005, 0.0)


def test_a_slope_leaves_no_bias() -> None:
    """Steep slope, points only in one half of each cell: the mean of a cell would be off."""
    rng = np.random.default_rng(0)
    cells = rng.uniform(1.0, 48.0, (60_000, 2))
    x, y = 0.002 * cells.T
    z = 0.8 * x - 0.5 * y
    grid = Grid(0.0, 0.0, 50, 50, 0.002)
    heights, valid = average(x, y, z, grid)
    gx, gy = np.meshgrid(0.002 * np.arange(50), 0.002 * np.arange(50))
    inner = np.s_[3:46, 3:46]
    assert valid[inner].all()
    error = (heights - (0.8 * gx - 0.5 * gy))[inner]
    assert abs(error.mean()) < 1e-5
    assert error.std() < 1.5e-4


def test_single_gaps_are_filled_and_holes_are_not() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    keep = np.ones((20, 20), dtype=bool)
    keep[5, 5] = False
    keep[10:15, 10:15] = False
    grid = Grid(0.0, 0.0, 20, 20, 1.0)
    values, valid = average(x[keep], y[keep], np.full(keep.sum(), 3.0), grid)
    assert values[5, 5] == pytest.approx(3.0)
    assert valid[5, 5]
    assert not valid[11:14, 11:14].any()
    assert (values[11:14, 11:14] == 0.0).all()


def test_several_values_at_once() -> None:
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    both, valid = average(
        x.ravel(), y.ravel(), np.column_stack([x.ravel(), y.ravel()]), Grid(0.0, 0.0, 6, 6, 1.0)
    )
    assert both.shape == (6, 6, 2)
    assert valid[:5, :5].all()
    np.testing.assert_allclose(both[:5, :5, 0], x[:5, :5])
    np.testing.assert_allclose(both[:5, :5, 1], y[:5, :5])
