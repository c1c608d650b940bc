"""Camera files of other programs, as the fields of a `Camera`.

Read are, beside the project's own keys: ROS (`camera_info` as YAML, or as a message is printed),
OpenCV's `FileStorage` (YAML, JSON), Kalibr's camchain, librealsense's intrinsics (JSON, YAML, or as
`rs-enumerate-devices -c` prints them), and Open3D's JSON. All of them are YAML, or nearly.
"""

import difflib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import read_text, refuse_repeated_keys

#: Endings of camera files.
ENDINGS = (".yaml", ".yml", ".json", ".txt")

#: Keys that a camera file must have.
WANTED = ("width", "height", "fx", "fy", "cx", "cy")

#: A camera file, for messages.
EXAMPLE = (
    "name: my-camera, width: 640, height: 480, fx: 525.0, fy: 525.0, cx: 319.5, cy: 239.5, "
    "distortion: [], sensor: xtion"
)

#: The project's own keys, and other spellings of them.
_OWN = (*WANTED, "name", "distortion", "sensor", "crop", "colour")
_SPELLINGS = {
    "ppx": "cx",
    "ppy": "cy",
    "coeffs": "distortion",
    "image_width": "width",
    "image_height": "height",
    "camera_name": "name",
}

#: Keys of an intrinsic matrix, and of distortion coefficients, in lower case.
_MATRICES = ("camera_matrix", "cameramatrix", "intrinsic_matrix", "k", "m1", "m2")
_DISTORTIONS = ("distortion_coefficients", "distcoeffs", "dist_coeffs", "d", "d1", "d2")

#: Names of lens models that are OpenCV's five coefficients, or none.
_MODELS = (
    "",
    "none",
    "plumb_bob",
    "radtan",
    "brown_conrady",
    "brown conrady",
    "modified_brown_conrady",
    "pinhole",
    "rational_polynomial",
)

#: Keys of other formats that say nothing about the intrinsics.
_IGNORED = re.compile(
    r"header|calibration_time|nr_of_frames|nframes|board_|square_|flags|avg_|rms|"
    r"per_view|extrinsic|image_points|grid_points|r$|p$|rectification_matrix|projection_matrix|"
    r"binning|roi|timeshift|t_cam|t_cn|rostopic|cam_overlaps|camera_model|model|fov|hfov|vfov|"
    r"distortion_model|frame_id|stream|format|fps|serial|intrinsic of|rotation|translation|"
    r"reprojection_error|cam_info|timestamp|index"
)

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


class _Loader(yaml.SafeLoader):
    """Reads OpenCV's matrices as mappings."""


def _opencv_matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)


def camera_fields(path: Path) -> tuple[dict[str, Any], bool]:
    """Read a camera file of any known format.

    Args:
        path: of the file.

    Returns:
        The fields of a `Camera` that the file has, and whether its format is the project's own.

    Raises:
        InputError: the file is missing, is of no known format, holds several cameras, or a lens
            model that is not OpenCV's.
    """
    raw = {str(key): value for key, value in _mapping(path).items()}
    if set(raw) <= set(_OWN):
        return raw, True
    lower = {key.lower(): value for key, value in raw.items()}
    chains = [key for key in lower if re.fullmatch(r"cam\d+", key)]
    if chains:
        return _kalibr(path, lower, chains), False
    if len({"m1", "m2"} & set(lower)) == 2:
        raise InputError(
            f"{path}: holds two cameras, M1 and M2; write a file of one, e.g. {EXAMPLE}"
        )
    return _other(path, raw, lower), False


def _mapping(path: Path) -> dict[Any, Any]:
    text = read_text(path)
    # OpenCV writes `%YAML:1.0`, librealsense separates by tabs, ROS ends a message with `---`.
    text = re.sub(r"\A%YAML[: ]?1\.0[^\n]*\n", "", text).replace("\t", " ")
    lines = (line for line in text.splitlines() if not line.strip().startswith("Intrinsic of"))
    text = "\n".join(lines)
    refuse_repeated_keys(text, path)
    try:
        documents = [one for one in yaml.load_all(text, _Loader) if one is not None]
    except yaml.YAMLError as error:
        mark: Any = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{path}: is not valid YAML{where}; wanted e.g. {EXAMPLE}") from None
    if not documents or not isinstance(documents[0], dict):
        raise InputError(f"{path}: is no camera file; wanted e.g. {EXAMPLE}")
    return documents[0]


def _kalibr(path: Path, raw: Mapping[str, Any], chains: list[str]) -> dict[str, Any]:
    """Return the fields of a Kalibr file with one camera."""
    if len(chains) > 1:
        raise InputError(
            f"{path}: holds the cameras {', '.join(chains)}; keep one of them in a file"
        )
    (name,) = chains
    camera = raw[name]
    if not isinstance(camera, dict):
        raise InputError(f"{path}: {name} is no camera; wanted e.g. {EXAMPLE}")
    if camera.get("camera_model", "pinhole") != "pinhole":
        raise InputError(
            f"{path}: camera model {camera['camera_model']!r} is not read; calibrate as pinhole"
        )
    coefficients = numbers(camera.get("distortion_coeffs", []))
    _check_model(path, camera.get("distortion_model", "radtan"), coefficients)
    fields: dict[str, Any] = {"name": path.stem, "distortion": coefficients}
    for keys, entry in (
        (("fx", "fy", "cx", "cy"), "intrinsics"),
        (("width", "height"), "resolution"),
    ):
        values = numbers(camera.get(entry, []))
        if len(values) != len(keys):
            raise InputError(
                f"{path}: {name}.{entry} needs {', '.join(keys)}; wanted e.g. {EXAMPLE}"
            )
        fields |= dict(zip(keys, values, strict=True))
    return _whole(path, fields)


def _other(path: Path, raw: Mapping[str, Any], lower: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a file of ROS, OpenCV, librealsense or Open3D."""
    fields: dict[str, Any] = {}
    coefficients: list[float] = []
    for key, value in lower.items():
        if key in _MATRICES:
            fields |= _of_matrix(path, key, value)
        elif key in _DISTORTIONS or _SPELLINGS.get(key) == "distortion":
            coefficients = numbers(value)
        elif key in ("image_size", "imagesize", "resolution"):
            size = numbers(value)
            if len(size) == 2:
                fields |= {"width": size[0], "height": size[1]}
        elif key != "colour" and _SPELLINGS.get(key, key) in _OWN:
            fields[_SPELLINGS.get(key, key)] = value
        elif not (_IGNORED.match(key) or key == "distortion"):
            _refuse_key(path, next(name for name in raw if name.lower() == key))
    if isinstance(lower.get("distortion"), str):  # librealsense prints the lens model so
        fields.pop("distortion", None)
        _check_model(path, lower["distortion"], coefficients)
    model = lower.get("distortion_model", lower.get("model", ""))
    _check_model(path, model, coefficients)
    if "colour" in lower:
        fields["colour"] = lower["colour"]
    if coefficients:
        fields["distortion"] = coefficients
    fields.setdefault("name", path.stem)
    fields = _whole(path, fields)
    return _region(path, fields, lower)


def _refuse_key(path: Path, key: str) -> None:
    near = difflib.get_close_matches(key, _OWN, 1)
    cure = f"did you mean {near[0]}?" if near else f"wanted e.g. {EXAMPLE}"
    if re.search(r"scale|unit", key.lower()):
        cure = "give the depth unit with --depth-unit"
    raise InputError(f"{path}: there is no key {key!r}; {cure}")


def _region(path: Path, fields: dict[str, Any], lower: Mapping[str, Any]) -> dict[str, Any]:
    """Apply ROS's region of interest and binning: the intrinsics are those of the full image."""
    roi = lower.get("roi")
    values = roi if isinstance(roi, dict) else {}
    left, top, width, height = (
        int(values.get(key) or 0) for key in ("x_offset", "y_offset", "width", "height")
    )
    across, down = (int(lower.get(f"binning_{axis}") or 1) or 1 for axis in "xy")
    if not all(key in fields for key in WANTED):
        return fields
    if width and height and (width, height) != (fields["width"], fields["height"]):
        fields["crop"] = [left, top, fields["width"], fields["height"]]
        fields |= {"width": width, "height": height}
        fields["cx"] -= left
        fields["cy"] -= top
    if (across, down) != (1, 1):
        raise InputError(
            f"{path}: binning {across} x {down}; write the intrinsics of the binned image, "
            f"e.g. {EXAMPLE}"
        )
    return fields


def _whole(path: Path, fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with numbers as numbers: programs print 1e-05, which YAML reads as text."""
    for key in WANTED:
        if key not in fields:
            continue
        try:
            value = float(fields[key])
        except (TypeError, ValueError):
            raise InputError(f"{path}: {key} is {fields[key]!r}, wanted a number") from None
        fields[key] = round(value) if key in ("width", "height") else value
    return fields


def _of_matrix(path: Path, key: str, value: Any) -> dict[str, float]:
    """Return fx, fy, cx, cy of an intrinsic matrix, row by row, or by columns as Open3D's."""
    entries = numbers(value)
    if len(entries) != 9:
        raise InputError(f"{path}: {key} has {len(entries)} numbers, wanted nine; e.g. {EXAMPLE}")
    K: NDArray[np.float64] = np.reshape(entries, (3, 3))
    if K[0, 2] == K[1, 2] == 0.0 and K[2, 0] != 0.0:
        K = K.T
    if abs(K[0, 1]) > 1e-3 * abs(K[0, 0]) or K[2, 2] != 1.0:
        raise InputError(f"{path}: {key} is no matrix [fx 0 cx; 0 fy cy; 0 0 1]: {entries}")
    return {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}


def _check_model(path: Path, model: Any, coefficients: list[float]) -> None:
    """Refuse coefficients of a lens model that is not OpenCV's five."""
    plain = str(model or "").lower().removeprefix("distortion.").strip()
    if any(coefficients) and plain not in _MODELS:
        raise InputError(
            f"{path}: lens model {model!r} with coefficients is not read; calibrate with OpenCV's "
            "k1, k2, p1, p2, k3, or give rectified depth with distortion: []"
        )


def numbers(value: Any) -> list[float]:
    """Return the numbers of a value: a list, a list of lists, OpenCV's matrix, or a text."""
    if isinstance(value, dict):
        value = value.get("data", [])
    if isinstance(value, str):
        return [float(match.group()) for match in _NUMBER.finditer(value)]
    try:
        return [float(number) for number in np.ravel(np.asarray(value, dtype=float))]
    except (TypeError, ValueError):
        return []
