"""Rigid poses as (4, 4) arrays X_AB (B in A), and their form in YAML files."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError


@dataclass(frozen=True)
class PoseRecord:
    """A pose in a YAML file: translation [x, y, z] in metres, rotation as three rows."""

    translation: list[float] = dataclasses.field(default_factory=list)
    rotation: list[list[float]] = dataclasses.field(default_factory=list)

    def matrix(self, name: str) -> Pose:
        """Return the pose (4, 4).

        Raises:
            InputError: it is no rigid motion; the message begins with `name`.
        """
        if np.shape(self.translation) != (3,) or np.shape(self.rotation) != (3, 3):
            raise InputError(f"{name}: a pose needs translation [x, y, z] and rotation, three rows")
        X = pose(np.array(self.rotation), np.array(self.translation))
        check_pose(X, name)
        return X

    @staticmethod
    def of(X: Pose) -> "PoseRecord":
        """Return the record of a pose (4, 4)."""
        return PoseRecord(X[:3, 3].tolist(), X[:3, :3].tolist())


def pose(R: NDArray[np.float64], p: NDArray[np.float64]) -> Pose:
    """Return the pose (4, 4) of rotation R (3, 3) and translation p (3,)."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def inverse(X: Pose) -> Pose:
    """Return the inverse of a rigid motion (4, 4)."""
    R_T = X[:3, :3].T
    return pose(R_T, -R_T @ X[:3, 3])


def transformed(X_AB: Pose, p_BQ: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (..., 3) given in B in A."""
    return np.asarray(p_BQ @ X_AB[:3, :3].T + X_AB[:3, 3])


def turn(axis: str, angle: float) -> Pose:
    """Return the pure rotation (4, 4) by an angle in radians about "x", "y" or "z"."""
    return pose(Rotation.from_euler(axis, angle).as_matrix(), np.zeros(3))


def check_pose(X: Pose, name: str) -> None:
    """Refuse an array that is no rigid motion (4, 4).

    Raises:
        InputError: it is none; the message begins with `name`.
    """
    good = X.shape == (4, 4) and bool(np.isfinite(X).all())
    if good:
        R = X[:3, :3]
        good = np.allclose(R @ R.T, np.eye(3), atol=1e-6)
        good = good and np.allclose(X[3], [0.0, 0.0, 0.0, 1.0])
        good = good and float(np.linalg.det(R)) > 0.0
    if not good:
        raise InputError(f"{name}: the pose is no rigid motion (4, 4)")
