"""Hand-eye calibration: exact on exact poses, accurate on noisy ones, refusals."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose
from unwrinkle.perception.calibration.hand_eye import (
    angle_between,
    daniilidis,
    mean_pose,
    outlying,
    park_martin,
    solve_hand_eye,
    tsai_lenz,
    turn_spread,
)
from unwrinkle.perception.stereo.head_file import nominal_head

UNIT = nominal_head().left.unit


def _random_pose(rng: np.random.Generator, turn: float = 3.0, shift: float = 1.0) -> Pose:
    R = Rotation.from_rotvec(turn * rng.uniform(-1.0, 1.0, 3)).as_matrix()
    return pose(R, shift * rng.uniform(-1.0, 1.0, 3))


def _looks(
    mounts: list[Pose], X_MC: Pose, X_BT: Pose, rng: np.random.Generator, noise: float = 0.0
) -> list[Pose]:
    """Poses of the board in the camera, each turned and shifted by noise (radians, metres)."""
    return [inverse(X_BM @ X_MC) @ X_BT @ _random_pose(rng, noise, noise) for X_BM in mounts]


def _pan_tilt(rng: np.random.Generator, count: int = 15) -> list[Pose]:
    return [UNIT.mount_pose(*angles) for angles in rng.uniform(-0.2, 0.2, (count, 2))]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_exact_poses_give_the_exact_camera(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X_MC, X_BT = _random_pose(rng, 1.5, 0.3), _random_pose(rng)
    for mounts in ([_random_pose(rng, 0.8) for _ in range(9)], _pan_tilt(rng, 9)):
        found = tsai_lenz(mounts, _looks(mounts, X_MC, X_BT, rng))
        np.testing.assert_allclose(found, X_MC, atol=1e-7)


def test_solution_has_camera_board_and_agreement() -> None:
    rng = np.random.default_rng(1)
    X_MC, X_BT = _random_pose(rng, 1.5, 0.1), pose(np.eye(3), np.array([2.4, 0.1, -0.3]))
    mounts = _pan_tilt(rng)
    found = solve_hand_eye(mounts, _looks(mounts, X_MC, X_BT, rng, 1e-4))
    assert np.degrees(angle_between(found.X_MC, X_MC)) < 0.05
    assert np.linalg.norm(found.X_MC[:3, 3] - X_MC[:3, 3]) < 0.002
    assert np.linalg.norm(found.X_BT[:3, 3] - X_BT[:3, 3]) < 0.002
    assert 0.0 < found.turn_apart < np.radians(0.1)
    assert 0.0 < found.board_shift.max() < 0.002
    assert found.spread[1] > np.radians(15.0)


def _by_opencv(mounts: list[Pose], X_CT: list[Pose], method: int) -> Pose:
    R, p = cv2.calibrateHandEye(
        [X[:3, :3] for X in mounts],
        [X[:3, 3] for X in mounts],
        [X[:3, :3] for X in X_CT],
        [X[:3, 3] for X in X_CT],
        method=method,
    )
    return pose(R, np.ravel(p))


@pytest.mark.skipif(not hasattr(cv2, "calibrateHandEye"), reason="OpenCV 5 has none")
@pytest.mark.parametrize(
    ("method", "code", "noise", "tolerance"),
    [
        (tsai_lenz, "TSAI", 0.0, 1e-12),  # with noise, OpenCV's weighs the pairs differently
        (park_martin, "PARK", 0.0, 1e-12),
        (park_martin, "PARK", 1e-3, 1e-12),
        (daniilidis, "DANIILIDIS", 0.0, 1e-12),
        (daniilidis, "DANIILIDIS", 1e-3, 1e-12),
    ],
)
def test_methods_are_opencvs(
    method: Callable[[list[Pose], list[Pose]], Pose], code: str, noise: float, tolerance: float
) -> None:
    rng = np.random.default_rng(9)
    for mounts in ([_random_pose(rng, 0.6) for _ in range(15)], _pan_tilt(rng)):
        X_CT = _looks(mounts, _random_pose(rng, 1.5, 0.1), _random_pose(rng), rng, noise)
        wanted = _by_opencv(mounts, X_CT, getattr(cv2, f"CALIB_HAND_EYE_{code}"))
        np.testing.assert_allclose(method(mounts, X_CT), wanted, atol=tolerance)


def test_tsai_is_as_good_as_park() -> None:
    """Mean errors over many noisy cases."""
    rng = np.random.default_rng(2)
    errors = np.zeros((30, 2))
    for row in errors:
        X_MC, X_BT = _random_pose(rng, 1.5, 0.1), _random_pose(rng)
        mounts = [_random_pose(rng, 0.6) for _ in range(15)]
        X_CT = _looks(mounts, X_MC, X_BT, rng, 1e-4)
        row[:] = [angle_between(method(mounts, X_CT), X_MC) for method in (tsai_lenz, park_martin)]
    ours, parks = np.degrees(errors.mean(axis=0))
    assert ours < 0.004
    assert ours < 1.2 * parks


def test_park_refuses_poses_of_the_camera_in_place_of_the_boards() -> None:
    """Inverse poses turn the other way: the rotation vectors are mirrored."""
    rng = np.random.default_rng(4)
    mounts = [_random_pose(rng, 0.6) for _ in range(9)]
    X_CT = _looks(mounts, _random_pose(rng, 0.3, 0.1), _random_pose(rng, 0.3), rng)
    with pytest.raises(InputError, match="mirror"):
        park_martin(mounts, [inverse(X) for X in X_CT])


def test_daniilidis_refuses_a_mount_that_stands_still() -> None:
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="turn the mount"):
        daniilidis([_random_pose(rng)] * 9, [_random_pose(rng)] * 9)


@pytest.mark.parametrize("axis", [0, 1])
def test_turning_about_one_axis_is_refused(axis: int) -> None:
    rng = np.random.default_rng(3)
    angles = np.zeros((12, 2))
    angles[:, axis] = rng.uniform(-0.3, 0.3, 12)
    angles[:, 1 - axis] = rng.uniform(-0.03, 0.03, 12)
    mounts = [UNIT.mount_pose(*a) for a in angles]
    X_CT = _looks(mounts, _random_pose(rng, 1.5, 0.1), _random_pose(rng), rng)
    with pytest.raises(InputError, match=r"only 3\.\d about a second one"):
        solve_hand_eye(mounts, X_CT)


def test_pan_and_tilt_together_are_one_axis() -> None:
    """Both angles vary, but along one line: still a single axis of rotation."""
    rng = np.random.default_rng(4)
    mounts = [UNIT.mount_pose(a, 0.5 * a) for a in rng.uniform(-0.2, 0.2, 12)]
    X_CT = _looks(mounts, _random_pose(rng, 1.5, 0.1), _random_pose(rng), rng)
    with pytest.raises(InputError, match="second"):
        solve_hand_eye(mounts, X_CT)


def test_too_few_looks_are_refused() -> None:
    rng = np.random.default_rng(5)
    mounts = _pan_tilt(rng, 7)
    X_CT = _looks(mounts, np.eye(4), _random_pose(rng), rng)
    with pytest.raises(InputError, match="7 usable looks"):
        solve_hand_eye(mounts, X_CT)
    with pytest.raises(InputError, match="6 of the board"):
        solve_hand_eye(mounts, X_CT[:6])


def test_methods_that_disagree_are_refused() -> None:
    """Angles of other images: the methods weigh the nonsense differently."""
    rng = np.random.default_rng(6)
    mounts = _pan_tilt(rng)
    X_CT = _looks(mounts, _random_pose(rng, 1.5, 0.1), _random_pose(rng), rng)
    with pytest.raises(InputError, match="may not belong to the images"):
        solve_hand_eye(mounts, X_CT[::-1])


@pytest.mark.parametrize("wrong", [(3,), (0, 9), (1, 5, 8)])
def test_looks_with_angles_of_others_are_found(wrong: tuple[int, ...]) -> None:
    rng = np.random.default_rng(7)
    mounts = _pan_tilt(rng)
    X_CT = _looks(mounts, _random_pose(rng, 1.5, 0.1), _random_pose(rng), rng, 2e-4)
    for look in wrong:
        mounts[look] = UNIT.mount_pose(*rng.uniform(0.1, 0.2, 2) * rng.choice([-1, 1], 2))
    np.testing.assert_array_equal(np.flatnonzero(outlying(mounts, X_CT)), wrong)


def test_spread_names_the_axes() -> None:
    angles: NDArray[np.float64] = np.array([[a, b] for a in (-0.2, 0.2) for b in (-0.1, 0.1)])
    spread, axes = turn_spread([UNIT.mount_pose(*a) for a in angles])
    np.testing.assert_allclose(spread[:2], [0.4, 0.2], rtol=0.02)
    assert abs(axes[0, 2]) > 0.99
    assert abs(axes[1, 1]) > 0.99


def test_mean_pose_is_between() -> None:
    X = pose(Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix(), np.array([1.0, 0.0, 0.0]))
    middle = mean_pose([X, np.eye(4)])
    np.testing.assert_allclose(middle[:3, 3], [0.5, 0.0, 0.0])
    assert angle_between(middle, np.eye(4)) == pytest.approx(0.1)
