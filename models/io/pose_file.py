"""Pose files: rigid motions as this project, ROS and robot pendants write them.

Read are `translation` with `rotation` (three rows), a matrix (4 x 4), quaternions whose order is
named, rotation vectors, roll-pitch-yaw angles, ROS's Pose, Transform and their stamped messages,
and the text of `tf2_echo`. Lengths are metres, angles radians unless the key says degrees.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import read_text, refuse_repeated_keys
from unwrinkle.models.transforms import check_translation, nearest_pose, pose

#: A pose file, for messages.
EXAMPLE = "translation: [0.0, -1.1, 2.1], rotation: [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]"

#: Largest distance of a quaternion's length from 1: it is printed with three decimals.
_MAX_LENGTH_ERROR = 0.003

#: Largest angle in radians.
_MAX_ANGLE = 2.0 * np.pi + 0.01

#: Keys of a rotation, with the reader of their values.
_ROTATIONS = (
    "rotation",
    "orientation",
    "quaternion",
    "quaternion_xyzw",
    "quaternion_wxyz",
    "rotation_vector",
    "rpy",
    "rpy_degrees",
)
_TRANSLATIONS = ("translation", "position")
_MATRICES = ("matrix", "transformation", "T", "X_WC", "X_WG")
_IGNORED = ("header", "child_frame_id", "covariance", "name")


def load_pose(path: str | Path) -> Pose:
    """Read a pose (4, 4) from a file.

    Raises:
        InputError: the file is missing, of no known form, ambiguous, or no rigid motion; the
            message names the file.
    """
    path = Path(path)
    text = read_text(path)
    if echoed := _tf2_echo(text):
        return _composed(*echoed, str(path))
    refuse_repeated_keys(text, path)
    try:
        documents = [one for one in yaml.safe_load_all(text) if one is not None]
    except yaml.YAMLError as error:
        mark: Any = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{path}: is not valid YAML{where}; wanted e.g. {EXAMPLE}") from None
    if not documents:
        raise InputError(f"{path}: is empty; wanted e.g. {EXAMPLE}")
    return pose_of(documents[0], str(path))


def pose_of(value: Any, name: str) -> Pose:
    """Return the pose (4, 4) of a value read from YAML.

    Args:
        value: mapping or matrix in one of the forms of the module's docstring.
        name: of the file, for messages.

    Raises:
        InputError: as `load_pose`.
    """
    if isinstance(value, list):
        return _of_matrix(value, name)
    if not isinstance(value, dict):
        raise InputError(f"{name}: is no pose; wanted e.g. {EXAMPLE}")
    raw = {str(key): item for key, item in value.items()}
    _check_frames(raw, name)
    for inner in ("transform", "pose"):  # ROS's messages; of one with a covariance twice
        if isinstance(raw.get(inner), dict):
            rest = set(raw) - {inner, *_IGNORED}
            if rest:
                raise InputError(f"{name}: there is no key {min(rest)!r}; wanted e.g. {EXAMPLE}")
            return pose_of(raw[inner], name)
    known = (*_ROTATIONS, *_TRANSLATIONS, *_MATRICES, *_IGNORED)
    if unknown := [key for key in raw if key not in known]:
        raise InputError(f"{name}: there is no key {unknown[0]!r}; wanted e.g. {EXAMPLE}")
    if matrices := [key for key in _MATRICES if key in raw]:
        return _of_matrix(raw[matrices[0]], name)
    places = [key for key in _TRANSLATIONS if key in raw]
    turns = [key for key in _ROTATIONS if key in raw]
    if len(places) != 1 or len(turns) != 1:
        what = "one translation and one rotation"
        raise InputError(f"{name}: a pose needs {what}; wanted e.g. {EXAMPLE}")
    p = _numbers(raw[places[0]], "xyz", f"{name}: {places[0]}")
    if p.shape != (3,):
        raise InputError(f"{name}: {places[0]} needs [x, y, z] in metres")
    return _composed(p, _rotation(turns[0], raw[turns[0]], name), name)


def _composed(p: NDArray[np.float64], R: NDArray[np.float64], name: str) -> Pose:
    check_translation(p, name)
    return nearest_pose(pose(R, p), name)


def _rotation(key: str, value: Any, name: str) -> NDArray[np.float64]:
    """Return the matrix (3, 3) of a rotation in the form that its key and shape say."""
    order = "wxyz" if key.endswith("wxyz") else "xyzw"
    numbers = _numbers(value, order, f"{name}: {key}")
    if numbers.shape == (3, 3) and key in ("rotation", "orientation"):
        return numbers
    if numbers.size == 9 and key in ("rotation", "orientation"):
        return numbers.reshape(3, 3)
    quaternion = key in ("rotation", "orientation") or key.startswith("quaternion")
    if quaternion and numbers.shape == (4,):
        if not isinstance(value, dict) and not key.endswith(("xyzw", "wxyz")):
            raise InputError(
                f"{name}: {key} has four numbers in an unknown order; write quaternion_xyzw: "
                "[x, y, z, w] (ROS prints them so) or quaternion_wxyz: [w, x, y, z]"
            )
        return _of_quaternion(numbers if order == "xyzw" else np.roll(numbers, -1), name)
    if numbers.shape == (3,):
        return _of_angles(key, numbers, name)
    raise InputError(f"{name}: {key} has the shape {numbers.shape}; wanted e.g. {EXAMPLE}")


def _of_quaternion(xyzw: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    length = float(np.linalg.norm(xyzw))
    if abs(length - 1.0) > _MAX_LENGTH_ERROR:
        raise InputError(
            f"{name}: the quaternion has the length {length:.4f}, wanted 1; is a digit wrong?"
        )
    return Rotation.from_quat(xyzw).as_matrix()


def _of_angles(key: str, numbers: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the matrix of a rotation vector or of roll, pitch, yaw about fixed axes."""
    if key == "rpy_degrees":
        return Rotation.from_euler("xyz", numbers, degrees=True).as_matrix()
    if key not in ("rpy", "rotation_vector"):
        raise InputError(
            f"{name}: {key} has three numbers; write rotation_vector: [rx, ry, rz] or rpy: [roll, "
            "pitch, yaw], radians, or rpy_degrees"
        )
    if np.abs(numbers).max() > _MAX_ANGLE:
        raise InputError(f"{name}: {key} {numbers.tolist()} is not in radians")
    if key == "rpy":
        return Rotation.from_euler("xyz", numbers).as_matrix()
    return Rotation.from_rotvec(numbers).as_matrix()


def _of_matrix(value: Any, name: str) -> Pose:
    """Return the pose of 4 x 4 or 3 x 4 rows, or of their numbers one after the other."""
    numbers = _numbers(value, "", name)
    if numbers.size == 6:
        raise InputError(
            f"{name}: six numbers are a pose in an unknown convention; write translation: [x, y, "
            "z] in metres with rotation_vector: [rx, ry, rz] or rpy: [roll, pitch, yaw] in radians"
        )
    if numbers.size not in (12, 16):
        raise InputError(f"{name}: is no pose, it has {numbers.size} numbers; e.g. {EXAMPLE}")
    X = np.eye(4)
    X[: numbers.size // 4] = numbers.reshape(-1, 4)
    if not np.allclose(X[3], [0.0, 0.0, 0.0, 1.0]):
        if np.allclose(X[:, 3], [0.0, 0.0, 0.0, 1.0]):
            raise InputError(f"{name}: the matrix is transposed; write the translation as column")
        raise InputError(f"{name}: the last row of the matrix is {X[3].tolist()}, not [0, 0, 0, 1]")
    return _composed(X[:3, 3], X[:3, :3], name)


def _numbers(value: Any, keys: str, name: str) -> NDArray[np.float64]:
    """Return the numbers of a list, or of a mapping with one-letter keys in the given order."""
    if isinstance(value, dict):
        if "data" in value:
            value = value["data"]
        elif set(map(str, value)) == set(keys):
            value = [value[key] for key in keys]
        else:
            raise InputError(f"{name} needs {', '.join(keys)}; wanted e.g. {EXAMPLE}")
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: has values that are no numbers; wanted e.g. {EXAMPLE}") from None
    if not np.isfinite(found).all():
        raise InputError(f"{name}: has a number that is not finite")
    return found


def _check_frames(raw: Mapping[str, Any], name: str) -> None:
    """Refuse a stamped transform whose frames say that it is the world in the camera."""
    header = raw.get("header")
    parent = str(header.get("frame_id", "")) if isinstance(header, dict) else ""
    child = str(raw.get("child_frame_id", ""))
    world = re.compile(r"(^|[/_])(world|map|base|base_link|odom|robot)$")
    if re.search(r"camera|optical", parent) and world.search(child):
        raise InputError(
            f"{name}: is the pose of {child} in {parent}; wanted is the camera in the world, the "
            "inverse"
        )


def _tf2_echo(text: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return translation and rotation of what ROS's `tf2_echo` prints; None for another text."""
    number = r"\s*([-+\d.eE]+)\s*"
    place = re.search(rf"Translation:\s*\[{number},{number},{number}\]", text)
    turn = re.search(rf"Quaternion(?:\s*\(xyzw\))?\s*\[{number},{number},{number},{number}\]", text)
    if place is None or turn is None:
        return None
    try:
        p, q = (np.array([float(item) for item in match.groups()]) for match in (place, turn))
    except ValueError:
        return None
    return p, _of_quaternion(q, "tf2_echo")
