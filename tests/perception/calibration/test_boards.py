"""Detection of calibration boards in synthetic images: corners, numbering, refusals."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import pose, transformed
from unwrinkle.perception.calibration.boards import (
    Board,
    BoardView,
    NoBoard,
    board_pose,
    find_board,
    load_grey,
)
from unwrinkle.perception.camera import Camera

BOARD = Board(9, 6, 0.03)
CHARUCO = Board(9, 6, 0.03, "DICT_5X5_100", 0.022)
CAMERA = Camera("c", 900, 700, 1000.0, 990.0, 455.0, 340.0, [-0.1, 0.2, 0.0, 0.0, 0.0])

Draw = Callable[..., NDArray[np.uint8]]


def _placed(turn: float = 0.2, tilt: tuple[float, float] = (0.4, -0.3), z: float = 0.6) -> Pose:
    R = Rotation.from_rotvec([*tilt, 0.0]) * Rotation.from_rotvec([0.0, 0.0, turn])
    X_CT = pose(R.as_matrix(), np.array([0.01, -0.005, z]))
    X_CT[:3, 3] -= X_CT[:3, :3] @ BOARD.points_T.mean(axis=0)
    return X_CT


def _view(image: NDArray[np.uint8], board: Board = BOARD) -> BoardView:
    found = find_board(image, board)
    assert isinstance(found, BoardView), found
    return found


def _errors(view: BoardView, X_CT: Pose) -> NDArray[np.float64]:
    points = BOARD.points_T[view.ids]
    np.testing.assert_array_equal(points, view.points_T)
    return np.linalg.norm(view.corners - CAMERA.project(transformed(X_CT, points)), axis=1)


@pytest.mark.parametrize("turn", [0.2, 1.4, 3.0, -2.0])
@pytest.mark.parametrize(
    ("board", "rms"), [(BOARD, 0.05), (CHARUCO, 0.12)], ids=["chessboard", "charuco"]
)
def test_corners_are_found_to_a_small_part_of_a_pixel(
    draw_board: Draw, board: Board, rms: float, turn: float
) -> None:
    """Markers leave a ChArUco board's corners less of the picture."""
    X_CT = _placed(turn)
    view = _view(draw_board(board, CAMERA, X_CT, noise=4.0, blur=0.8), board)
    assert len(view.ids) >= 48
    errors = _errors(view, X_CT)
    assert np.sqrt(np.mean(errors**2)) < rms
    assert errors.max() < 4.5 * rms


def test_noise_of_a_dim_picture_costs_little(draw_board: Draw) -> None:
    """Corners refined in the unsmoothed picture are off by 0.2 px and more here."""
    X_CT = _placed(z=0.45)
    view = _view(draw_board(BOARD, CAMERA, X_CT, contrast=0.35, noise=7.0, blur=0.8))
    assert np.sqrt(np.mean(_errors(view, X_CT) ** 2)) < 0.12


def test_a_large_picture_is_refined_in_full(draw_board: Draw) -> None:
    big = Camera("b", 2000, 1500, 2200.0, 2200.0, 1000.0, 750.0)
    X_CT = _placed(z=0.7)
    view = _view(draw_board(BOARD, big, X_CT, noise=4.0))
    wanted = big.project(transformed(X_CT, BOARD.points_T))
    assert np.linalg.norm(view.corners - wanted, axis=1).max() < 0.12


def test_a_picture_taken_upside_down_numbers_the_same_corners(draw_board: Draw) -> None:
    X_CT = _placed()
    image = draw_board(BOARD, CAMERA, X_CT)
    turned = _view(np.ascontiguousarray(image[::-1, ::-1]))
    last = np.array([CAMERA.width - 1, CAMERA.height - 1])
    np.testing.assert_allclose(last - turned.corners, _view(image).corners, atol=0.02)


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("size", [(8, 5), (9, 7), (9, 6)])
def test_both_patterns_of_charuco_boards_are_found(
    draw_board: Draw, size: tuple[int, int], legacy: bool
) -> None:
    board = Board(*size, 0.03, "DICT_5X5_100", 0.022)
    X_CT = _placed()
    view = _view(draw_board(board, CAMERA, X_CT, noise=3.0, legacy=legacy), board)
    assert len(view.ids) > 0.7 * size[0] * size[1]
    seen = CAMERA.project(transformed(X_CT, view.points_T))
    assert np.linalg.norm(view.corners - seen, axis=1).max() < 0.6


def test_part_of_a_charuco_board_is_enough(draw_board: Draw) -> None:
    X_CT = _placed(z=0.33)
    X_CT[0, 3] += 0.10
    view = _view(draw_board(CHARUCO, CAMERA, X_CT, noise=3.0), CHARUCO)
    assert 14 < len(view.ids) < 50
    assert _errors(view, X_CT).max() < 0.4


def test_part_of_a_chessboard_is_not(draw_board: Draw) -> None:
    X_CT = _placed(z=0.33)
    X_CT[0, 3] += 0.10
    found = find_board(draw_board(BOARD, CAMERA, X_CT), BOARD, name="a.png")
    assert isinstance(found, NoBoard)
    assert found.name == "a.png"
    assert "no chessboard of 9x6" in found.reason


def test_pose_of_a_board(draw_board: Draw) -> None:
    X_CT = _placed()
    found = board_pose(_view(draw_board(BOARD, CAMERA, X_CT, noise=3.0)), CAMERA)
    np.testing.assert_allclose(found[:3, 3], X_CT[:3, 3], atol=2e-4)
    np.testing.assert_allclose(found[:3, :3], X_CT[:3, :3], atol=2e-3)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_nothing_is_no_board(level: int) -> None:
    for board in (BOARD, CHARUCO):
        found = find_board(np.full((480, 640), level, np.uint8), board)
        assert isinstance(found, NoBoard)


def test_another_size_of_board_is_no_board(draw_board: Draw) -> None:
    image = draw_board(BOARD, CAMERA, _placed())
    assert isinstance(find_board(image, Board(10, 7, 0.03)), NoBoard)


def test_real_corner_that_the_search_puts_beside_is_mended(shared_data: Path) -> None:
    """right05's first search has a corner 7 px off; the plane through the others has it right."""
    view = _view(load_grey(shared_data / "stereo_chessboard" / "right05.jpg"))
    homography, _ = cv2.findHomography(view.points_T[:, :2], view.corners)
    plane = cv2.perspectiveTransform(view.points_T[None, :, :2], homography)[0]
    assert np.linalg.norm(plane - view.corners, axis=1).max() < 0.6


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ((2, 6, 0.03), "at least 3"),
        ((9, 7, 0.03), "half a turn"),
        ((9, 6, 0.0), "metres"),
        ((9, 6, 25.0), "metres"),
        ((9, 6, 0.03, "DICT_9", 0.02), "DICT_5X5_100"),
        ((9, 6, 0.03, "DICT_5X5_100", 0.03), "smaller than squares"),
    ],
)
def test_boards_that_cannot_be(fields: tuple[int, int, float], named: str) -> None:
    with pytest.raises(InputError, match=named):
        Board(*fields)


def test_a_charuco_board_may_be_symmetric() -> None:
    assert Board(7, 7, 0.03, "DICT_5X5_100", 0.02).points_T.shape == (49, 3)


def test_colour_images_are_refused() -> None:
    with pytest.raises(InputError, match="uint8"):
        find_board(np.zeros((10, 10, 3), np.uint8), BOARD)


def test_bad_image_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such image"):
        load_grey(tmp_path / "none.png")
    for content in (b"", b"not an image"):
        (tmp_path / "bad.png").write_bytes(content)
        with pytest.raises(InputError, match="no image"):
            load_grey(tmp_path / "bad.png")
