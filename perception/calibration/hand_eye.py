"""Hand-eye calibration: the pose of a camera on its moving mount, from A X = X B.

Frames: B the mechanism's base, M its moving mount, C the camera, T a fixed board.
X_BT = X_BM X_MC X_CT is the same for every view, so for two views i and j

    A X = X B,  A = inverse(X_BM_j) X_BM_i,  X = X_MC,  B = X_CT_j inverse(X_CT_i).

The pose is that of `tsai_lenz`, checked by two other methods. All three are implemented here, since
OpenCV 5 has no `calibrateHandEye`; the tests compare them with OpenCV 4's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose
from unwrinkle.perception.calibration.projection import crosses

#: Least number of views.
MIN_VIEWS = 8

#: Least range of rotation about a second axis, radians.
LEAST_TURN = np.radians(6.0)

#: Largest disagreement of the methods, radians and metres.
_MAX_DISAGREEMENT_RAD = np.radians(0.5)
_MAX_DISAGREEMENT_M = 0.015

#: Least inconsistency of an outlying view, radians.
_MIN_OUTLIER_RAD = np.radians(0.3)

#: Inconsistency of an outlying view, multiples of the median.
_OUTLIER_RATIO = 6.0


@dataclass(frozen=True, eq=False)
class HandEye:
    """Outcome of a hand-eye calibration.

    Attributes:
        X_MC: (4, 4) pose of the camera on its mount.
        X_BT: (4, 4) pose of the board in the base frame, mean over the views.
        turn_apart, shift_apart: largest disagreement of the other methods with X_MC, radians and
            metres.
        spread: (3,) range of the mount's rotation about its principal axes, radians, largest first.
        board_shift: (views,) distance of the board from X_BT, metres.
        board_turn: (views,) rotation of the board from X_BT, radians.
    """

    X_MC: Pose
    X_BT: Pose
    turn_apart: float
    shift_apart: float
    spread: NDArray[np.float64]
    board_shift: NDArray[np.float64]
    board_turn: NDArray[np.float64]


def solve_hand_eye(
    X_BM: Sequence[Pose], X_CT: Sequence[Pose], *, name: str = "hand-eye calibration"
) -> HandEye:
    """Estimate the camera on its mount by Tsai-Lenz and check it by two other methods.

    Args:
        X_BM: poses (4, 4) of the mount, one for each view.
        X_CT: poses (4, 4) of the board in the camera's frame, in the same order.
        name: for messages.

    Raises:
        InputError: fewer than 8 views, too little rotation about a second axis, or methods that
            disagree.
    """
    if len(X_BM) != len(X_CT):
        raise InputError(f"{name}: {len(X_BM)} poses of the mount, {len(X_CT)} of the board")
    if len(X_BM) < MIN_VIEWS:
        raise InputError(
            f"{name}: {len(X_BM)} usable looks, wanted at least {MIN_VIEWS}; take more"
        )
    spread, axes = turn_spread(X_BM)
    if spread[1] < LEAST_TURN:
        first, second = (np.round(axis, 2) + 0.0 for axis in axes[:2])
        raise InputError(
            f"{name}: the mount turns by {np.degrees(spread[0]):.1f} degrees about its axis "
            f"{first} but by only {np.degrees(spread[1]):.1f} about a second one, {second}; wanted "
            f"at least {np.degrees(LEAST_TURN):.0f} about both, add looks turned about that axis"
        )
    X_MC = tsai_lenz(X_BM, X_CT)
    others = [method(X_BM, X_CT) for method in _CROSS_CHECKS.values()]
    turns = [angle_between(X_MC, other) for other in others]
    shifts = [float(np.linalg.norm(X_MC[:3, 3] - other[:3, 3])) for other in others]
    if max(turns) > _MAX_DISAGREEMENT_RAD or max(shifts) > _MAX_DISAGREEMENT_M:
        apart = ", ".join(
            f"{method} by {np.degrees(turn):.2f} degrees and {1e3 * shift:.1f} mm"
            for method, turn, shift in zip(_CROSS_CHECKS, turns, shifts, strict=True)
        )
        raise InputError(
            f"{name}: methods disagree with Tsai's ({apart}; at most "
            f"{np.degrees(_MAX_DISAGREEMENT_RAD):.1f} degrees and {1e3 * _MAX_DISAGREEMENT_M:.0f} "
            "mm); the angles or poses may not belong to the images, or turn the mount more"
            + (f"; poses {max(shifts):.0f} m off are not in metres" if max(shifts) > 1.0 else "")
        )
    boards = [M @ X_MC @ T for M, T in zip(X_BM, X_CT, strict=True)]
    X_BT = mean_pose(boards)
    return HandEye(
        X_MC=X_MC,
        X_BT=X_BT,
        turn_apart=max(turns),
        shift_apart=max(shifts),
        spread=spread,
        board_shift=np.array([np.linalg.norm(X[:3, 3] - X_BT[:3, 3]) for X in boards]),
        board_turn=np.array([angle_between(X, X_BT) for X in boards]),
    )


def tsai_lenz(X_BM: Sequence[Pose], X_CT: Sequence[Pose]) -> Pose:
    """Compute X_MC (4, 4) by R. Y. Tsai and R. K. Lenz (1989) over all pairs of views.

    Rotation: with P = 2 sin(angle / 2) axis of A and of B, solve (P_A + P_B) x P' = P_B - P_A
    (their Eq. 12), P = 2 P' / sqrt(1 + |P'|^2) (Eq. 14); then (R_A - I) p = R_X p_B - p_A (Eq. 15).
    """
    A, B = _motions(X_BM, X_CT)
    P_A, P_B = _half_turns(A), _half_turns(B)
    difference = (P_B - P_A).ravel()
    halved = np.linalg.lstsq(crosses(P_A + P_B).reshape(-1, 3), difference, rcond=None)[0]
    P = 2.0 * halved / np.sqrt(1.0 + halved @ halved)
    R = (1.0 - 0.5 * (P @ P)) * np.eye(3)
    R = R + 0.5 * (np.outer(P, P) + np.sqrt(4.0 - P @ P) * crosses(P[None])[0])
    return pose(R, _translation(A, B, R))


def park_martin(X_BM: Sequence[Pose], X_CT: Sequence[Pose]) -> Pose:
    """Compute X_MC (4, 4) by F. C. Park and B. J. Martin (1994) over all pairs of views.

    The rotation is the one that best aligns the rotation vectors of B with those of A.

    Raises:
        InputError: a mirror image aligns them better than any rotation.
    """
    A, B = _motions(X_BM, X_CT)
    a, b = (Rotation.from_matrix(X[:, :3, :3]).as_rotvec() for X in (A, B))
    if np.linalg.det(a.T @ b) < 0.0:
        raise InputError(
            "hand-eye calibration: the mount's motions are like a mirror image of the boards'; the "
            "angles or poses may not belong to the images, or turn the mount more"
        )
    R = Rotation.align_vectors(a, b)[0].as_matrix()
    return pose(R, _translation(A, B, R))


def daniilidis(X_BM: Sequence[Pose], X_CT: Sequence[Pose]) -> Pose:
    """Compute X_MC (4, 4) by K. Daniilidis (1999) over all pairs of views.

    Rotation and translation are found together, as a unit dual quaternion in the space of the two
    least singular vectors of his matrix (Eq. 31 and 33 to 35).

    Raises:
        InputError: no unit dual quaternion lies there, e.g. where the mount does not turn.
    """
    (a, a_dual), (b, b_dual) = (_dual_quaternion_vectors(X) for X in _motions(X_BM, X_CT))
    rows = np.zeros((len(a), 6, 8))
    rows[:, :3, 0] = rows[:, 3:, 4] = a - b
    rows[:, :3, 1:4] = rows[:, 3:, 5:] = crosses(a + b)
    rows[:, 3:, 0] = a_dual - b_dual
    rows[:, 3:, 1:4] = crosses(a_dual + b_dual)
    null = np.linalg.svd(rows.reshape(-1, 8), full_matrices=False)[2][-2:]
    product = null[:, :4] @ null[:, 4:].T
    # Of a unit dual quaternion, the two parts are orthogonal: two directions in that plane.
    (low, high), axes = np.linalg.eigh(product + product.T)
    first, second = np.sqrt(max(high, 0.0)) * axes[:, 0], np.sqrt(max(-low, 0.0)) * axes[:, 1]
    found = max(((first + sign * second) @ null for sign in (1, -1)), key=lambda q: q[:4] @ q[:4])
    real, dual = found[:4], found[4:]
    length = float(np.linalg.norm(real))
    if not length > 1e-9 * float(np.linalg.norm(found)):
        raise InputError(
            "hand-eye calibration: the views do not determine the pose of the camera on its mount; "
            "turn the mount more, about two axes"
        )
    (w, v), (w_dual, v_dual) = ((q[0] / length, q[1:] / length) for q in (real, dual))
    R = Rotation.from_quat([*v, w]).as_matrix()
    return pose(R, 2.0 * (w * v_dual - w_dual * v + np.cross(v, v_dual)))


def turn_spread(X_BM: Sequence[Pose]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the range (3,) of a mount's rotation about its principal axes, radians, and the axes.

    The axes (3, 3) are rows, in the mount's frame at its mean attitude; largest range first.
    """
    attitudes = Rotation.from_matrix(np.array([X[:3, :3] for X in X_BM]))
    vectors = (attitudes.mean().inv() * attitudes).as_rotvec()
    _, _, axes = np.linalg.svd(vectors - vectors.mean(axis=0))
    ranges = np.ptp(vectors @ axes.T, axis=0)
    order = np.argsort(-ranges, kind="stable")
    return ranges[order], axes[order]


def contradictions(X_BM: Sequence[Pose], X_CT: Sequence[Pose]) -> NDArray[np.float64]:
    """Return the inconsistency of each view with the others, (views,), radians, for any X_MC.

    A and B rotate by the same angle. A view's inconsistency is the median difference of these
    angles over its pairs with all other views.
    """
    n = len(X_BM)
    A, B = _motions(X_BM, X_CT)
    table = np.full((n, n), np.nan)
    pairs = np.array(list(combinations(range(n), 2)))
    difference = np.abs(_angles(A) - _angles(B))
    table[pairs[:, 0], pairs[:, 1]] = table[pairs[:, 1], pairs[:, 0]] = difference
    return np.asarray(np.nanmedian(table, axis=1))


def outlying(X_BM: Sequence[Pose], X_CT: Sequence[Pose]) -> NDArray[np.bool_]:
    """Return the mask (views,) of views inconsistent with the others (e.g. mismatched angles)."""
    found = contradictions(X_BM, X_CT)
    return np.asarray(found > max(_MIN_OUTLIER_RAD, _OUTLIER_RATIO * float(np.median(found))))


def mean_pose(poses: Sequence[Pose]) -> Pose:
    """Return the mean of poses (4, 4) that are close to each other."""
    attitudes = Rotation.from_matrix(np.array([X[:3, :3] for X in poses]))
    return pose(attitudes.mean().as_matrix(), np.mean([X[:3, 3] for X in poses], axis=0))


def angle_between(X: Pose, Y: Pose) -> float:
    """Return the angle between the rotations of two poses, radians."""
    return float(Rotation.from_matrix(X[:3, :3].T @ Y[:3, :3]).magnitude())


_CROSS_CHECKS: dict[str, Callable[[Sequence[Pose], Sequence[Pose]], Pose]] = {
    "Park-Martin": park_martin,
    "Daniilidis": daniilidis,
}


def _motions(
    X_BM: Sequence[Pose], X_CT: Sequence[Pose]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return A and B of every pair of views, (pairs, 4, 4)."""
    pairs = list(combinations(range(len(X_BM)), 2))
    A = np.array([inverse(X_BM[j]) @ X_BM[i] for i, j in pairs])
    B = np.array([X_CT[j] @ inverse(X_CT[i]) for i, j in pairs])
    return A, B


def _translation(
    A: NDArray[np.float64], B: NDArray[np.float64], R: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve (R_A - I) p = R p_B - p_A for p (3,), given the rotation R (3, 3) of X."""
    left = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (B[:, :3, 3] @ R.T - A[:, :3, 3]).ravel()
    return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0])


def _dual_quaternion_vectors(
    X: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the vectors (n, 3) of the real and of the dual part of each motion."""
    q = Rotation.from_matrix(X[:, :3, :3]).as_quat(canonical=True)
    v, w, p = q[:, :3], q[:, 3:], X[:, :3, 3]
    return v, 0.5 * (w * p + np.cross(p, v))


def _angles(X: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(Rotation.from_matrix(X[:, :3, :3]).magnitude())


def _half_turns(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 2 sin(angle / 2) axis of each motion, (n, 3)."""
    return 2.0 * Rotation.from_matrix(X[:, :3, :3]).as_quat(canonical=True)[:, :3]
