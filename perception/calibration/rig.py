"""Kinematic model that all calibrations share: cameras on mounts on bases, and boards.

Frames: A common frame, B base of a mechanism, M its mount (X_BM known), C camera, T board. A corner
p_T is seen at project(X_CT p_T), X_CT = inverse(X_AB X_BM X_MC) X_AT. The model covers a stereo
pair, cameras on pan-tilt units, and a gripper camera.
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
    """Unknowns of a bundle adjustment.

    Attributes:
        cameras: intrinsics of each eye.
        mounts: X_MC of each eye.
        bases: X_AB of each base; the first one is held.
        boards: X_AT of each place of a board.
    """

    cameras: tuple[Camera, ...]
    mounts: tuple[Pose, ...]
    bases: tuple[Pose, ...]
    boards: tuple[Pose, ...]


@dataclass(frozen=True, eq=False)
class BoardObservation:
    """A board observed in one image.

    Attributes:
        view: the corners.
        eye, base, board: indices into the rig's cameras and mounts, bases, and boards.
        X_BM: (4, 4) pose of the mount when the image was taken.
        axes: (k, 6) twist of the mount, in its own frame, per radian of each joint with angle
            noise.
        stop: index of the joint configuration; observations of one eye and stop share the joints'
            errors.
    """

    view: BoardView
    eye: int
    base: int
    board: int
    X_BM: Pose
    axes: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros((0, 6)))
    stop: int = 0


def moved(X: Pose, twist: NDArray[np.float64]) -> Pose:
    """Return X exp(twist), with the coupling of translation and rotation to first order."""
    step = pose(Rotation.from_rotvec(twist[3:]).as_matrix(), twist[:3])
    return np.asarray(X @ step)


def joint_axes(
    mount_pose: Callable[[float, float], Pose], first: float, second: float
) -> NDArray[np.float64]:
    """Return the twists (2, 6) of a mount, in its own frame, per radian of each of its two joints.

    Args:
        mount_pose: function from two angles, radians, to X_BM (4, 4).
        first, second: the angles, radians.
    """
    step = 1e-6
    twists = np.empty((2, 6))
    for row, (a, b) in enumerate(((step, 0.0), (0.0, step))):
        X = inverse(mount_pose(first - a, second - b)) @ mount_pose(first + a, second + b)
        twists[row] = [*X[:3, 3], X[2, 1], X[0, 2], X[1, 0]]
    return twists / (2.0 * step)
