"""Rigid poses as (4, 4) arrays X_AB (B in A), and their form in YAML files."""

import dataclasses
import logging
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError

_log = logging.getLogger(__name__)

#: Largest entry of the difference to the nearest rotation: of an exact one, and of one printed with
#: three decimals.
_EXACT = 1e-6
_MAX_ROUNDING = 0.002

#: Distance to the nearest rotation above which it is a warning.
_TOLD = 2e-4

#: Longest translation in a file, metres along an axis.
_MAX_TRANSLATION_M = 20.0


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
        p = np.array(self.translation, dtype=float)
        check_translation(p, name)
        return nearest_pose(pose(np.array(self.rotation), p), name)

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
    if rotation_error(X, name) > _EXACT:
        _refuse(X, name)


def nearest_pose(X: Pose, name: str) -> Pose:
    """Return a pose (4, 4) whose rotation was rounded, with the nearest rotation.

    Programs print three or four decimals. A larger distance is a digit that is wrong.

    Args:
        X: (4, 4) rigid motion, its rotation accurate to three decimals.
        name: of the file, for messages.

    Returns:
        X itself if it is exact.

    Raises:
        InputError: it is no rigid motion; the message begins with `name`.
    """
    error = rotation_error(X, name)
    if error <= _EXACT:
        return X
    if error > _MAX_ROUNDING:
        _refuse(X, name)
    R = _nearest_rotation(X[:3, :3])
    angle = float(np.degrees(error))
    _log.log(
        logging.WARNING if error > _TOLD else logging.INFO,
        "%s: the rotation has few decimals; the nearest rotation is used, %.4f (%.2f degrees) away",
        name,
        error,
        angle,
    )
    return pose(R, X[:3, 3])


def rotation_error(X: Pose, name: str) -> float:
    """Return the largest difference of the rotation's entries to the nearest rotation's.

    Raises:
        InputError: the array is no (4, 4) transform, or mirrors; the message begins with `name`.
    """
    if X.shape != (4, 4) or not np.isfinite(X).all():
        raise InputError(f"{name}: the pose is no rigid motion, wanted (4, 4) finite numbers")
    R = X[:3, :3]
    if not np.allclose(X[3], [0.0, 0.0, 0.0, 1.0]) or float(np.linalg.det(R)) <= 0.0:
        _refuse(X, name)
    return float(np.abs(R - _nearest_rotation(R)).max())


def check_translation(p: NDArray[np.float64], name: str) -> None:
    """Refuse a translation (3,) that is no length within a cell, in metres.

    Raises:
        InputError: it is longer than 20 m; the message begins with `name`.
    """
    far = float(np.abs(p).max())
    if not far <= _MAX_TRANSLATION_M:
        raise InputError(
            f"{name}: the translation {p.tolist()} reaches {far:.0f} m; write it in metres, these "
            "look like millimetres"
        )


def _nearest_rotation(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the orthogonal matrix nearest to R (3, 3), by its singular vectors."""
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def _refuse(X: Pose, name: str) -> NoReturn:
    """Raise the error that says why a transform (4, 4) is no rigid motion.

    Raises:
        InputError: always.
    """
    R = X[:3, :3]
    determinant = float(np.linalg.det(R))
    if not np.allclose(X[3], [0.0, 0.0, 0.0, 1.0]):
        why = f"its last row is {X[3].tolist()}, not [0, 0, 0, 1]"
    elif determinant <= 0.0:
        why = f"its rotation mirrors (determinant {determinant:.2f}); is an axis turned round?"
    else:
        away = float(np.abs(R - _nearest_rotation(R)).max())
        why = (
            f"the nearest rotation is {away:.4f} away, at most {_MAX_ROUNDING} by rounding; write "
            "the rotation with four decimals or more"
        )
    raise InputError(f"{name}: the pose is no rigid motion; {why}")
