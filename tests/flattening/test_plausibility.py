"""Garments and tables that cannot be where depth and pose put them."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import unwrinkle as uw
from unwrinkle.flattening.capture_to_observation import map_of
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.transforms import inverse
from unwrinkle.perception.depth.capture import Capture

CAMERA = uw.Camera("c", 320, 240, 262.0, 262.0, 159.5, 119.5, sensor="stereo")


@pytest.fixture(scope="module")
def cell() -> Cell:
    return uw.load_cell()


def _capture(scale: float = 1.0, **changes: Any) -> Capture:
    """Return a cloth of 0.5 x 0.4 m seen from 1 m, all lengths times a factor."""
    x, y = CAMERA.rays()
    on = (np.abs(x) < 0.25) & (np.abs(y) < 0.2)
    ridge = 0.025 * np.exp(-0.5 * (y / 0.015) ** 2) * (np.abs(x) < 0.15)
    depth = 1.0 - np.where(on, 0.003 + ridge, 0.0)
    depth = depth + np.random.default_rng(0).normal(0.0, 1e-4, depth.shape)
    return dc.replace(Capture((scale * depth).astype(np.float32), CAMERA, name="scene"), **changes)


def _pose(cell: Cell, height: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """Return a camera 1 m above the table, raised and tilted (m, rad)."""
    X = np.diag([-1.0, 1.0, -1.0, 1.0])
    c, s = np.cos(tilt), np.sin(tilt)
    X[:3, :3] = X[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    X[:3, 3] = (*cell.table.centre, cell.table.height + 1.0 + height)
    return X


def test_a_good_capture_has_its_garment(cell: Cell) -> None:
    for capture in (_capture(), _capture(X_WC=_pose(cell))):
        found = map_of(capture, cell)
        assert found.garment.sum() * found.resolution**2 == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("scale", [3.0, 4.0, 5.0, 0.1])
def test_a_wrong_unit_shows_by_the_garments_size(cell: Cell, scale: float) -> None:
    with pytest.raises(InputError, match=r"scene: .*--depth-unit"):
        map_of(_capture(scale), cell)


@pytest.mark.parametrize("scale", [0.5, 2.0, 5.0])
def test_a_wrong_unit_shows_by_the_tables_height(cell: Cell, scale: float) -> None:
    with pytest.raises(InputError, match=r"cell's"):
        map_of(_capture(scale, X_WC=_pose(cell)), cell)


@pytest.mark.parametrize("height", [0.03, -0.03, 0.3, -0.3, 1.0])
def test_a_pose_that_is_too_high_or_too_low_is_named(cell: Cell, height: float) -> None:
    with pytest.raises(InputError, match=r"camera's pose.* 0\.700 m"):
        map_of(_capture(X_WC=_pose(cell, height)), cell)


def test_a_small_error_of_the_pose_is_noted(cell: Cell, caplog: pytest.LogCaptureFixture) -> None:
    map_of(_capture(X_WC=_pose(cell, 0.015)), cell)
    assert "15 mm above the cell's" in caplog.text


def _inverted(X: np.ndarray) -> np.ndarray:
    return inverse(X)


def _of_link(X: np.ndarray) -> np.ndarray:
    """Return the pose of ROS's camera_link, x forward."""
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    return np.asarray(X @ turn)


@pytest.mark.parametrize(("wrong", "named"), [(_inverted, "inverse"), (_of_link, "optical")])
@pytest.mark.parametrize("tilt", [0.0, 0.02])
def test_the_direction_and_the_frame_of_a_pose_are_named(
    cell: Cell, wrong: Callable[[np.ndarray], np.ndarray], named: str, tilt: float
) -> None:
    with pytest.raises(InputError, match=named):
        map_of(_capture(X_WC=wrong(_pose(cell, tilt=tilt))), cell)
