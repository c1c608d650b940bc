"""Stereo calibration: real chessboards, known cameras, and mismatched pairs."""

import dataclasses
import logging
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose, transformed
from unwrinkle.perception.calibration.boards import Board, BoardView
from unwrinkle.perception.calibration.files import find_board_pairs, find_pairs
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.calibration.stereo import (
    PairView,
    calibrate_camera,
    calibrate_stereo,
    row_error,
)
from unwrinkle.perception.camera import Camera

BOARD = Board(9, 6, 0.03)
LEFT = Camera("left", 1200, 900, 1500.0, 1490.0, 590.0, 455.0, [-0.05, 0.2, 0.0, 0.0, 0.0])
RIGHT = Camera("right", 1200, 900, 1480.0, 1475.0, 610.0, 440.0, [-0.08, 0.1, 0.0, 0.0, 0.0])
X_LR = pose(Rotation.from_euler("y", -0.15).as_matrix(), np.array([0.2, 0.002, 0.01]))


def _pairs(
    seed: int = 0, count: int = 12, noise: float = 0.05, tilt: float = 0.5
) -> list[PairView]:
    rng = np.random.default_rng(seed)
    pairs: list[PairView] = []
    while len(pairs) < count:
        R = Rotation.from_rotvec([*rng.uniform(-tilt, tilt, 2), 0.0])
        R = R * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])
        X_LT = pose(R.as_matrix(), np.array([0.08, 0.0, 1.0]) + rng.uniform(-0.2, 0.2, 3))
        X_LT[:3, 3] -= X_LT[:3, :3] @ BOARD.points_T.mean(axis=0)
        pairs.append(
            PairView(
                f"p{len(pairs)}",
                _seen(LEFT, X_LT, noise, rng),
                _seen(RIGHT, inverse(X_LR) @ X_LT, noise, rng),
            )
        )
    return pairs


def _seen(camera: Camera, X_CT: Pose, noise: float, rng: np.random.Generator) -> BoardView:
    corners = camera.project(transformed(X_CT, BOARD.points_T))
    corners = corners + noise * rng.standard_normal(corners.shape)
    ids = np.arange(len(corners))
    return BoardView(BOARD.points_T, corners, ids, camera.width, camera.height, camera.name)


def test_real_chessboards_meet_the_targets(shared_data: Path) -> None:
    folder = shared_data / "stereo_chessboard"
    board = Board(9, 6, 0.025)
    pairs, missing = find_board_pairs(find_pairs([folder]), board)
    assert len(pairs) == 8
    assert not missing
    found = calibrate_stereo(pairs, board).calibration
    assert not found.rejected
    assert found.rms < 0.15
    assert found.row_error < 0.2
    storage = cv2.FileStorage(str(folder / "intrinsics.yml"), cv2.FILE_STORAGE_READ)
    owner = float(storage.getNode("M1").mat()[0, 0])
    for focal in (found.left.fx, found.left.fy, found.right.fx, found.right.fy):
        assert focal == pytest.approx(owner, rel=0.005)
    baseline = np.linalg.norm(found.relative.translation) / board.square
    assert baseline == pytest.approx(3.86, abs=0.05)


def test_known_cameras_are_found() -> None:
    found = calibrate_stereo(_pairs(), BOARD).calibration
    assert found.rms == pytest.approx(0.05 * np.sqrt(2.0), rel=0.1)
    for camera, truth in ((found.left, LEFT), (found.right, RIGHT)):
        assert (camera.width, camera.height) == (1200, 900)
        assert camera.fx == pytest.approx(truth.fx, rel=1e-3)
        assert camera.cx == pytest.approx(truth.cx, abs=2.0)
        assert camera.distortion[0] == pytest.approx(truth.distortion[0], abs=0.01)
        assert camera.distortion[2:] == [0.0, 0.0, 0.0]
    X = found.relative.matrix("relative")
    assert np.degrees(angle_between(X, X_LR)) < 0.1
    np.testing.assert_allclose(X[:3, 3], X_LR[:3, 3], atol=5e-4)
    assert found.row_error < 0.1


def test_parts_of_a_charuco_board_are_enough() -> None:
    """Each eye sees other corners; rows are compared of those that both see."""
    board = Board(9, 6, 0.03, "DICT_5X5_100", 0.022)
    rng = np.random.default_rng(10)

    def part(view: BoardView) -> BoardView:
        kept = np.sort(rng.choice(54, 35, replace=False))
        return dataclasses.replace(
            view, points_T=view.points_T[kept], corners=view.corners[kept], ids=kept
        )

    pairs = [PairView(p.name, part(p.left), part(p.right)) for p in _pairs(10)]
    found = calibrate_stereo(pairs, board).calibration
    assert found.left.fx == pytest.approx(LEFT.fx, rel=2e-3)
    assert found.row_error < 0.1
    again = calibrate_stereo(found.pair_views(), board).calibration
    assert again.left.fx == pytest.approx(found.left.fx, abs=0.05)
    assert len(again.views[0].left_ids) == 35


def test_it_is_opencvs_minimum() -> None:
    """The same corners through stereoCalibrate, run to its end."""
    pairs = _pairs(1)
    found = calibrate_stereo(pairs, BOARD).calibration
    flags = cv2.CALIB_ZERO_TANGENT_DIST + cv2.CALIB_FIX_K3 + cv2.CALIB_USE_INTRINSIC_GUESS
    _, K_1, _, K_2, _, R, p, *_ = cv2.stereoCalibrate(
        [pair.left.points_T.astype(np.float32) for pair in pairs],
        [pair.left.corners.astype(np.float32) for pair in pairs],
        [pair.right.corners.astype(np.float32) for pair in pairs],
        found.left.matrix,
        np.array(found.left.distortion),
        found.right.matrix,
        np.array(found.right.distortion),
        (1200, 900),
        flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 300, 1e-12),
    )
    assert found.left.fx == pytest.approx(K_1[0, 0], abs=0.3)
    assert found.right.fx == pytest.approx(K_2[0, 0], abs=0.3)
    X_RL = inverse(found.relative.matrix("relative"))
    np.testing.assert_allclose(X_RL[:3, 3], np.ravel(p), atol=2e-4)
    np.testing.assert_allclose(X_RL[:3, :3], R, atol=2e-4)


def test_a_right_image_of_another_moment_is_left_out_by_name() -> None:
    pairs = _pairs(2, 12)
    pairs[3] = dataclasses.replace(pairs[3], right=pairs[7].right)
    found = calibrate_stereo(pairs, BOARD).calibration
    assert len(found.views) == 11
    assert len(found.rejected) == 1
    assert found.rejected[0].startswith("p3: its images do not belong together")
    assert found.left.fx == pytest.approx(LEFT.fx, rel=2e-3)


def test_a_view_that_fits_badly_is_left_out_by_name() -> None:
    pairs = _pairs(3, 12)
    corners = pairs[5].left.corners.copy()
    corners[::7] += [1.5, -1.0]
    pairs[5] = dataclasses.replace(
        pairs[5], left=dataclasses.replace(pairs[5].left, corners=corners)
    )
    found = calibrate_stereo(pairs, BOARD, not_found=["p99: left: no board"]).calibration
    assert found.rejected[0] == "p99: left: no board"
    assert found.rejected[1].startswith("p5: left view fits to 0.")
    assert [view.name for view in found.views] == [f"p{k}" for k in range(12) if k != 5]


def test_pairs_all_of_other_moments_are_refused() -> None:
    pairs = _pairs(4, 14)
    shuffled = [
        dataclasses.replace(pair, right=pairs[(k + 1) % 14].right) for k, pair in enumerate(pairs)
    ]
    with pytest.raises(InputError, match=r"usable views.*do not belong together.*more\)"):
        calibrate_stereo(shuffled, BOARD)


def test_too_few_views_are_refused() -> None:
    with pytest.raises(InputError, match=r"7 usable views, wanted at least 8 \(left out: x\)"):
        calibrate_stereo(_pairs(count=7), BOARD, not_found=["x"])
    with pytest.raises(InputError, match="0 usable views"):
        calibrate_stereo([], BOARD)


def test_images_of_different_sizes_are_refused() -> None:
    pairs = _pairs(count=9)
    pairs[4] = dataclasses.replace(
        pairs[4], right=dataclasses.replace(pairs[4].right, width=1280, name="b.png")
    )
    with pytest.raises(InputError, match=r"right images have different sizes.*b\.png 1280 x 900"):
        calibrate_stereo(pairs, BOARD)


@pytest.mark.parametrize("tilt", [0.01, 0.05])
def test_a_board_hardly_tilted_is_refused(tilt: float) -> None:
    with pytest.raises(InputError, match=r"tilted by \d degrees about one axis and by \d about"):
        calibrate_stereo(_pairs(5, tilt=tilt), BOARD)


def test_a_board_tilted_about_one_axis_is_refused() -> None:
    rng, pairs = np.random.default_rng(6), []
    for k in range(12):
        R = Rotation.from_rotvec([rng.uniform(-0.5, 0.5), 0.02 * rng.standard_normal(), 0.0])
        X_LT = pose(R.as_matrix(), np.array([-0.05, -0.1, 1.0]) + rng.uniform(-0.1, 0.1, 3))
        views = [_seen(LEFT, X_LT, 0.05, rng), _seen(RIGHT, inverse(X_LR) @ X_LT, 0.05, rng)]
        pairs.append(PairView(f"p{k}", *views))
    with pytest.raises(InputError, match="about the other"):
        calibrate_stereo(pairs, BOARD)


def test_a_bent_board_is_refused() -> None:
    """Bent alike in every view: no single view sticks out, but nothing fits."""
    bend = 0.012 * (BOARD.points_T[:, 0] / BOARD.points_T[:, 0].max()) ** 2
    bent = BOARD.points_T + np.column_stack([np.zeros((54, 2)), bend])
    rng, pairs = np.random.default_rng(6), []
    for k in range(12):
        R = Rotation.from_rotvec([*rng.uniform(-0.6, 0.6, 2), 0.0])
        X_LT = pose(R.as_matrix(), np.array([-0.05, -0.05, 0.7]))
        views = []
        for camera, X in ((LEFT, X_LT), (RIGHT, inverse(X_LR) @ X_LT)):
            corners = camera.project(transformed(X, bent))
            views.append(BoardView(BOARD.points_T, corners, np.arange(54), 1200, 900))
        pairs.append(PairView(f"p{k}", *views))
    with pytest.raises(InputError, match=r"corners fit to \d\.\d+ px only|do not fit"):
        calibrate_stereo(pairs, BOARD)


def test_swapped_eyes_are_noticed(caplog: pytest.LogCaptureFixture) -> None:
    swapped = [PairView(pair.name, pair.right, pair.left) for pair in _pairs(7)]
    with caplog.at_level(logging.WARNING):
        calibrate_stereo(swapped, BOARD)
    assert "swapped" in caplog.text


def test_one_camera_alone() -> None:
    camera = calibrate_camera([pair.left for pair in _pairs(8)], "wrist")
    assert camera.name == "wrist"
    assert camera.fx == pytest.approx(LEFT.fx, rel=1e-3)


def test_row_error_sees_a_turned_eye() -> None:
    pairs = _pairs(9, noise=0.0)
    assert row_error(pairs, LEFT, RIGHT, X_LR) < 1e-3
    turned = X_LR @ pose(Rotation.from_euler("x", 0.001).as_matrix(), np.zeros(3))
    assert row_error(pairs, LEFT, RIGHT, turned) == pytest.approx(1.5, rel=0.1)
