"""Cameras on mounts on bases, and boards before them: one chain for every kind of calibration.

A (common frame), B (base of a mechanism), M (its mount, X_BM known), C (camera); T is the board.
A corner p_T is seen at project(X_CT p_T), X_CT = inverse(X_AB X_BM X_MC) X_AT. It describes a
stereo pair, cameras on pan-tilt units, and a camera in a gripper.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, pose
from unwrinkle.perception.calibration.boards import BoardView
from unwrinkle.perception.camera import Camera


@dataclass(frozen=True, eq=False)
class Rig:
    """What a bundle adjustment finds.

    Attributes:
        cameras: one for each eye.
        mounts: X_MC of each eye.
        bases: X_AB; the first one is never changed.
        boards: X_AT of each place that a board was put at.
    """

    cameras: tuple[Camera, ...]
    mounts: tuple[Pose, ...]
    bases: tuple[Pose, ...]
    boards: tuple[Pose, ...]


@dataclass(frozen=True, eq=False)
class BoardObservation:
    """A board in one image.

    Attributes:
        view: its corners.
        eye, base, board: indices into the rig's cameras and mounts, bases, and boards.
        X_BM: (4, 4) the mount when the image was taken.
        axes: (k, 6) twist of the mount, in its own frame, per radian of each joint whose angle is
            known to some noise only.
        stop: number of the stop that the joints were at; shots of one eye and stop share the
            joints' errors.
    """

    view: BoardView
    eye: int
    base: int
    board: int
    X_BM: Pose
    axes: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros((0, 6)))
    stop: int = 0


def moved(X: Pose, twist: NDArray[np.float64]) -> Pose:
    """X exp(twist), to first order in the translation's coupling with the turn."""
    step = pose(Rotation.from_rotvec(twist[3:]).as_matrix(), twist[:3])
    return np.asarray(X @ step)


def joint_axes(
    mount_pose: Callable[[float, float], Pose], first: float, second: float
) -> NDArray[np.float64]:
    """Twist (2, 6) of a mount, in its own frame, per radian of each of the two joints it hangs on.

    Args:
        mount_pose: X_BM (4, 4) at two angles in radians.
        first, second: the angles there.
    """
    step = 1e-6
    twists = np.empty((2, 6))
    for row, (a, b) in enumerate(((step, 0.0), (0.0, step))):
        X = inverse(mount_pose(first - a, second - b)) @ mount_pose(first + a, second + b)
        twists[row] = [*X[:3, 3], X[2, 1], X[0, 2], X[1, 0]]
    return twists / (2.0 * step)
