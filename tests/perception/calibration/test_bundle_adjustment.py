"""Bundle adjustment: derivatives, estimates, stated accuracy."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose, transformed
from unwrinkle.perception.calibration._bundle_problem import BundleProblem, levenberg_marquardt
from unwrinkle.perception.calibration.boards import Board, BoardView
from unwrinkle.perception.calibration.bundle_adjustment import Adjustment, adjust
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.calibration.rig import BoardObservation, Rig, moved
from unwrinkle.perception.camera import Camera

BOARD = Board(7, 6, 0.04)
K = [-0.05, 0.3, 0.0, 0.0, 0.0]
CAMERAS = (
    Camera("left", 1200, 900, 1500.0, 1490.0, 590.0, 455.0, K),
    Camera("right", 1200, 900, 1480.0, 1475.0, 610.0, 440.0, K),
)
AXES = np.array([[0.0, 0.01, 0.0, 0.0, 0.0, 1.0], [0.02, 0.0, 0.0, 0.0, 1.0, 0.0]])


def _turned(rng: np.random.Generator, angle: float) -> NDArray[np.float64]:
    return Rotation.from_rotvec(angle * rng.uniform(-1.0, 1.0, 3)).as_matrix()


def _rig_and_shots(
    seed: int, noise: float, joint_noise: float = 0.0, looks: int = 14
) -> tuple[Rig, list[BoardObservation]]:
    """Two eyes on mounts 0.3 m apart that look at a board 1.2 m before them, and at four more."""
    rng = np.random.default_rng(seed)
    mounts = tuple(pose(_turned(rng, 0.05), rng.uniform(-0.05, 0.05, 3)) for _ in CAMERAS)
    bases = (np.eye(4), pose(_turned(rng, 0.05), np.array([0.3, 0.0, 0.0])))
    boards = []
    for _ in range(5):
        X = pose(_turned(rng, 0.5), np.array([0.15, 0.0, 1.2]) + rng.uniform(-0.1, 0.1, 3))
        boards.append(moved(X, np.array([-0.12, -0.1, 0.0, 0.0, 0.0, 0.0])))
    rig = Rig(CAMERAS, mounts, bases, tuple(boards))
    shots = []
    for look in range(looks):
        for eye in (0, 1):
            X_BM = pose(_turned(rng, 0.2), rng.uniform(-0.02, 0.02, 3))
            board = 0 if look < looks - 4 else look - looks + 5
            off = joint_noise * rng.standard_normal(2) @ AXES
            X_CT = inverse(bases[eye] @ moved(X_BM, off) @ mounts[eye]) @ boards[board]
            corners = CAMERAS[eye].project(transformed(X_CT, BOARD.points_T))
            corners = corners + noise * rng.standard_normal(corners.shape)
            view = BoardView(BOARD.points_T, corners, np.arange(42), 1200, 900)
            axes = AXES if joint_noise else np.zeros((0, 6))
            shots.append(BoardObservation(view, eye, eye, board, X_BM, axes, look))
    return rig, shots


def _off(rig: Rig, seed: int, cameras: bool = True) -> Rig:
    """A start that is some millimetres, a fraction of a degree and some pixels off."""
    rng = np.random.default_rng(seed)

    def off(X: Pose) -> Pose:
        return moved(X, rng.uniform(-0.008, 0.008, 6))

    changed = tuple(
        dataclasses.replace(c, fx=c.fx * 1.01, fy=c.fy * 0.99, cx=c.cx + 8.0, distortion=[0.0] * 5)
        for c in rig.cameras
    )
    return Rig(
        changed if cameras else rig.cameras,
        tuple(off(X) for X in rig.mounts),
        (rig.bases[0], *(off(X) for X in rig.bases[1:])),
        tuple(off(X) for X in rig.boards),
    )


def test_derivatives_are_those_of_small_steps() -> None:
    rig, shots = _rig_and_shots(0, 0.1, joint_noise=1e-3, looks=6)
    noise = np.linspace(0.05, 0.2, len(shots))
    problem = BundleProblem(_off(rig, 0), shots, True, True, True, 1e-3, noise)
    rng = np.random.default_rng(1)
    change = 1e-3 * rng.standard_normal(problem.size)
    change[problem.joint_start :] *= 0.01
    state = problem.retract(problem.start, change)
    residual = problem.residual(state)
    step, J = 1e-6, np.zeros((residual.size, problem.size))
    for k in range(problem.size):
        one = step * np.eye(problem.size)[k]
        ahead, behind = (problem.residual(problem.retract(state, s)) for s in (one, -one))
        J[:, k] = (behind - ahead) / (2.0 * step)
    matrix, side = problem.normal_equations(state, residual)
    scale = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose((J.T @ J - matrix) / np.outer(scale, scale), 0.0, atol=2e-4)
    np.testing.assert_allclose(
        (J.T @ residual - side) / scale, 0.0, atol=2e-4 * abs(side / scale).max()
    )


def test_the_optimum_and_its_covariance_are_those_of_scipy() -> None:
    """From another start, by numerical derivatives, in one chart of the poses around the start."""
    rig, shots = _rig_and_shots(9, 0.2, joint_noise=1e-3, looks=6)
    noise = np.linspace(0.1, 0.3, len(shots))
    problem = BundleProblem(_off(rig, 9, cameras=False), shots, False, True, True, 1e-3, noise)
    state, covariance = levenberg_marquardt(problem, None)
    residual = problem.residual(state)
    there = least_squares(
        lambda step: problem.residual(problem.retract(problem.start, step)),
        np.zeros(problem.size),
        x_scale="jac",
    )
    assert residual @ residual == pytest.approx(2.0 * there.cost, rel=1e-7)
    found = problem.retract(problem.start, there.x)
    for X, Y in zip(state[0].mounts, found[0].mounts, strict=True):
        np.testing.assert_allclose(X, Y, atol=1e-5)
    here = least_squares(
        lambda step: problem.residual(problem.retract(state, step)),
        np.zeros(problem.size),
        x_scale="jac",
    )
    variance = 2.0 * here.cost / (len(residual) - problem.size)
    wanted = np.sqrt(np.diag(variance * np.linalg.inv(here.jac.T @ here.jac)))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), wanted, rtol=1e-3)


def test_exact_corners_give_the_exact_rig() -> None:
    rig, shots = _rig_and_shots(2, 0.0)
    found = adjust(_off(rig, 2), shots)
    assert found.rms < 1e-6
    for name in ("mounts", "bases", "boards"):
        for X, Y in zip(getattr(rig, name), getattr(found.rig, name), strict=True):
            np.testing.assert_allclose(X, Y, atol=1e-7)
    for camera, other in zip(rig.cameras, found.rig.cameras, strict=True):
        assert other.fx == pytest.approx(camera.fx, abs=1e-4)
        np.testing.assert_allclose(other.distortion, K, atol=1e-6)


def _mount_errors(found: Adjustment, rig: Rig) -> NDArray[np.float64]:
    """Twists from the true mounts to those found, (2, 6)."""
    twists = np.zeros((2, 6))
    for row, X, Y in zip(twists, rig.mounts, found.rig.mounts, strict=True):
        Z = inverse(X) @ Y
        row[:] = [*Z[:3, 3], *Rotation.from_matrix(Z[:3, :3]).as_rotvec()]
    return twists


def test_errors_are_as_large_as_it_says() -> None:
    """Errors over their stated deviations have RMS 1, over many runs."""
    ratios = []
    for seed in range(8):
        rig, shots = _rig_and_shots(seed, 0.2)
        found = adjust(_off(rig, seed), shots)
        assert found.rms == pytest.approx(0.2 * np.sqrt(2.0), rel=0.1)
        ratios.append(_mount_errors(found, rig) / found.mount_sigma)
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_joints_known_to_some_noise_are_found_too() -> None:
    rig, shots = _rig_and_shots(3, 0.05, joint_noise=1e-3)
    taken_as_exact = adjust(_off(rig, 3), shots)
    found = adjust(_off(rig, 3), shots, joint_noise=1e-3)
    assert taken_as_exact.rms > 0.5
    assert found.rms < 0.1
    assert 0.5e-3 < found.joint_errors.std() < 2e-3
    worse, better = (np.abs(_mount_errors(f, rig)).max() for f in (taken_as_exact, found))
    assert better < 0.6 * worse


def test_shots_without_joints_do_not_share_the_joints_of_their_stop() -> None:
    """A view of the stereo calibration (no joints) had the number of the first look's stop."""
    rig, shots = _rig_and_shots(4, 0.05, joint_noise=1e-3)
    without = dataclasses.replace(shots[0], axes=np.zeros((0, 6)), board=4)
    found = adjust(_off(rig, 4), [*shots, without], joint_noise=1e-3)
    assert not found.joint_errors[-1].any()
    assert found.joint_errors[0].all()


def test_a_blurred_shot_weighs_less() -> None:
    rig, shots = _rig_and_shots(5, 0.05)
    rng = np.random.default_rng(5)
    bad = shots[4].view
    spoilt = dataclasses.replace(bad, corners=bad.corners + rng.normal(0.0, 5.0, bad.corners.shape))
    found = adjust(
        _off(rig, 5), [*shots[:4], dataclasses.replace(shots[4], view=spoilt), *shots[5:]]
    )
    assert found.shot_rms[4] > 5.0
    assert np.degrees(angle_between(found.rig.mounts[0], rig.mounts[0])) < 0.02


def test_what_is_held_stays() -> None:
    rig, shots = _rig_and_shots(6, 0.05)
    start = _off(rig, 6, cameras=False)
    found = adjust(start, shots, intrinsics=False, bases=False)
    assert found.rig.cameras == rig.cameras
    np.testing.assert_array_equal(found.rig.bases[1], start.bases[1])
    assert not found.camera_sigma.any()
    assert found.mount_sigma.all()


def test_unknowns_that_no_corner_sees_are_refused() -> None:
    rig, shots = _rig_and_shots(7, 0.05)
    lonely = dataclasses.replace(rig, boards=(*rig.boards, rig.boards[0]))
    with pytest.raises(InputError, match="seen by no corner"):
        adjust(lonely, shots)
    still = [dataclasses.replace(shot, X_BM=np.eye(4), board=0) for shot in shots[:2]]
    with pytest.raises(InputError, match="do not determine"):
        adjust(dataclasses.replace(rig, boards=rig.boards[:1]), still)


def test_a_board_behind_the_camera_is_refused() -> None:
    rig, shots = _rig_and_shots(8, 0.05)
    behind = tuple(pose(X[:3, :3], -X[:3, 3]) for X in rig.boards)
    with pytest.raises(InputError, match="behind"):
        adjust(dataclasses.replace(rig, boards=behind), shots)
