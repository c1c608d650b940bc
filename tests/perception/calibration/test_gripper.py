"""Gripper camera calibration from views of a fixed board."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose, transformed
from unwrinkle.perception.calibration.boards import Board, BoardView
from unwrinkle.perception.calibration.gripper import calibrate_gripper_camera
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.camera import load_camera

BOARD = Board(8, 5, 0.03)
CAMERA = load_camera("xtion-pro-live")
X_GC = pose(Rotation.from_euler("xz", [0.3, 1.2]).as_matrix(), np.array([0.04, -0.06, 0.03]))
X_WT = pose(np.diag([1.0, -1.0, -1.0]), np.array([0.1, -1.1, 0.7]))


def _looks(seed: int, count: int = 14, noise: float = 0.1) -> tuple[list[Pose], list[BoardView]]:
    rng = np.random.default_rng(seed)
    poses, views = [], []
    for k in range(count):
        R = Rotation.from_rotvec([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.5, 1.5)])
        X_CT = pose(R.as_matrix(), np.array([0.0, 0.0, 0.6]) + rng.uniform(-0.06, 0.06, 3))
        X_CT[:3, 3] -= X_CT[:3, :3] @ BOARD.points_T.mean(axis=0)
        corners: NDArray[np.float64] = CAMERA.project(transformed(X_CT, BOARD.points_T))
        corners = corners + noise * rng.standard_normal(corners.shape)
        views.append(BoardView(BOARD.points_T, corners, np.arange(40), 640, 480, f"g{k}.png"))
        poses.append(X_WT @ inverse(X_CT) @ inverse(X_GC))
    return poses, views


@pytest.mark.parametrize("known", [True, False])
def test_camera_in_the_gripper_is_found(known: bool) -> None:
    found = calibrate_gripper_camera(*_looks(0), CAMERA if known else None)
    assert np.degrees(angle_between(found.X_GC, X_GC)) < 0.05
    near = 6e-4 if known else 2e-3
    np.testing.assert_allclose(found.X_GC[:3, 3], X_GC[:3, 3], atol=near)
    np.testing.assert_allclose(found.X_WT[:3, 3], X_WT[:3, 3], atol=near)
    assert found.rms == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)
    assert (found.camera == CAMERA) is known
    assert found.camera.fx == pytest.approx(CAMERA.fx, rel=4e-3)
    assert not found.rejected


def test_a_pose_of_another_look_is_left_out_by_name() -> None:
    poses, views = _looks(1)
    poses[5] = poses[8]
    found = calibrate_gripper_camera(poses, views, CAMERA)
    assert len(found.rejected) == 1
    assert found.rejected[0].startswith("g5.png: ")
    assert np.degrees(angle_between(found.X_GC, X_GC)) < 0.05


def test_a_pose_that_only_shifted_is_left_out_by_name() -> None:
    """The error shows in the reprojection only, not in the rotations."""
    poses, views = _looks(2)
    poses[3] = poses[3].copy()
    poses[3][0, 3] += 0.006
    found = calibrate_gripper_camera(poses, views, CAMERA)
    assert len(found.rejected) == 1
    assert found.rejected[0].startswith("g3.png: fits to ")


def test_a_wrong_size_of_squares_is_refused() -> None:
    poses, views = _looks(3)
    wrong = [
        BoardView(1.2 * view.points_T, view.corners, view.ids, 640, 480, view.name)
        for view in views
    ]
    with pytest.raises(InputError, match=r"its size right|do not fit|disagree"):
        calibrate_gripper_camera(poses, wrong, CAMERA)


def test_turning_about_the_wrist_only_is_refused() -> None:
    views = _looks(4)[1]
    poses = [
        pose(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix(), np.zeros(3))
        for angle in np.linspace(-1.0, 1.0, 14)
    ]
    with pytest.raises(InputError, match=r"second one|usable looks"):
        calibrate_gripper_camera(poses, views, CAMERA)


def test_too_few_looks_are_refused() -> None:
    with pytest.raises(InputError, match="7 usable looks"):
        calibrate_gripper_camera(*_looks(5, 7), CAMERA)
