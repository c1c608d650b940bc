"""Rendered calibration boards: detected corners agree with the known ones."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.rendering.boards import charuco_board, chessboard
from unwrinkle.simulation.rendering.image_noise import SensorModel, oversized, photograph
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.testing.table import TABLE

CAMERA = Camera("c", 800, 600, 1600.0, 1590.0, 391.2, 305.7, [-0.08, 0.3, 0.001, -0.0005])
MIDDLE = np.array([0.0, -1.15, 0.95])


def _poses(size: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X_WC of a camera 1.1 m from the middle, and X_WB of a board of a size, tipped and turned."""
    z = np.array([0.1, -0.7, -0.7])
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X_WC[:3, 3] = MIDDLE - 1.1 * z
    X_WB = np.eye(4)
    X_WB[:3, :3] = X_WC[:3, :3] @ cv2.Rodrigues(np.array([0.3, -0.25, 0.15]))[0]
    X_WB[:3, 3] = MIDDLE - X_WB[:3, :3] @ [0.5 * size[0], 0.5 * size[1], 0.0]
    return X_WC, X_WB


def _seen(
    X_WC: NDArray[np.float64], X_WB: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    p_W = corners @ X_WB[:3, :3].T + X_WB[:3, 3]
    return CAMERA.project((p_W - X_WC[:3, 3]) @ X_WC[:3, :3])


def _photograph(renderer: Renderer, X_WC: NDArray[np.float64]) -> NDArray[np.uint8]:
    wide = oversized(CAMERA)
    ideal = renderer.colour(wide, X_WC, quality=2)
    grey = np.asarray(cv2.cvtColor(ideal, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    return photograph(grey, wide, CAMERA, SensorModel(), seed=4)


def test_charuco_is_found_where_it_is_and_reads_the_right_way_round() -> None:
    """A mirrored or turned board would show other markers, or the same at other places."""
    board = charuco_board(8, 6, 0.03, 0.022, texel=0.0005)
    X_WC, X_WB = _poses(np.array([0.24, 0.18]))
    picture = _photograph(Renderer(TABLE, [board.at(X_WB).mesh]), X_WC)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    pattern = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.022, dictionary)
    np.testing.assert_allclose(board.corners, pattern.getChessboardCorners(), atol=1e-7)
    found, ids, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(picture)
    assert found is not None and len(found) >= 33
    error = found[:, 0] - _seen(X_WC, X_WB, board.corners)[ids[:, 0]]
    assert np.sqrt(np.mean(error**2)) < 0.08
    assert np.abs(error.mean(axis=0)).max() < 0.02


def test_chessboard_is_found_where_it_is() -> None:
    """Half a pixel, or half a texel, anywhere on the way would show twenty times over."""
    board = chessboard(9, 7, 0.027, texel=0.0005)
    X_WC, X_WB = _poses(np.array([9 * 0.027, 7 * 0.027]))
    renderer = Renderer(TABLE, [board.mesh])
    renderer.move("board", X_WB)
    picture = _photograph(renderer, X_WC)
    done, found = cv2.findChessboardCornersSB(picture, (8, 6), flags=cv2.CALIB_CB_ACCURACY)
    assert done
    error = found[:, 0] - _seen(X_WC, X_WB, board.corners)
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert np.abs(error.mean(axis=0)).max() < 0.025


def test_bad_boards_are_refused() -> None:
    with pytest.raises(InputError, match="2 x 6 squares"):
        chessboard(2, 6, 0.03)
    with pytest.raises(InputError, match="positive"):
        chessboard(5, 6, -0.03)
    with pytest.raises(InputError, match="texels larger"):
        chessboard(50, 6, 0.03)
    with pytest.raises(InputError, match="marker"):
        charuco_board(8, 6, 0.03, 0.03)
