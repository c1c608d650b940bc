"""The working table as a value."""

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.models.table import Table
from unwrinkle.models.transforms import turn
from unwrinkle.testing.table import TABLE


@pytest.mark.parametrize(
    ("centre", "size", "height"),
    [
        ((0.0, np.nan), (1.0, 1.0), 0.7),
        ((0.0, 0.0), (0.0, 1.0), 0.7),
        ((0.0, 0.0), (1.0, 1.0), 0.0),
        ((0.0, 0.0, 0.0), (1.0, 1.0), 0.7),
    ],
)
def test_numbers_that_no_table_has_are_refused(
    centre: tuple[float, float], size: tuple[float, float], height: float
) -> None:
    with pytest.raises(InputError):
        Table(centre, size, height)


def test_the_shipped_cell_has_the_table_of_the_scenes_without_a_robot() -> None:
    assert load_cell().table == TABLE


def test_points_are_outside_beyond_any_edge_less_the_inset() -> None:
    table = Table((1.0, -1.0), (0.8, 0.6), 0.7)
    points = np.array([[1.0, -1.0], [1.39, -1.0], [1.41, -1.0], [1.0, -1.31], [0.61, -0.71]])
    np.testing.assert_array_equal(table.outside(points), [False, False, True, True, False])
    np.testing.assert_array_equal(table.outside(points, 0.02), [False, True, True, True, True])
    assert table.overhang(points[0]) == 0.0
    assert table.overhang(np.array([1.43, -1.34])) == pytest.approx(0.05)
    assert table.overhang(np.array([1.39, -1.0]), 0.02) == pytest.approx(0.01)


@pytest.mark.parametrize(("axis", "angle"), [("z", 0.3), ("z", np.pi / 2), ("x", 0.02)])
def test_a_turned_table_is_refused(axis: str, angle: float) -> None:
    cell = load_cell()
    cell.__dict__["table_pose"] = cell.table_pose @ turn(axis, angle)
    with pytest.raises(InputError):
        _ = cell.table


def test_a_table_turned_by_half_a_turn_is_the_same() -> None:
    cell = load_cell()
    same = cell.table
    other = load_cell()
    other.__dict__["table_pose"] = cell.table_pose @ turn("z", np.pi)
    assert other.table == same
