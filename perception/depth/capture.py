"""Depth captures: depth image and camera, optionally colour and camera pose; file formats.

Depth files: `.png` of uint16 millimetres; `.npy`; `.npz`. Integers are millimetres, floats metres;
0, negative infinity, infinity and NaN mean "no reading". Keys of an `.npz`: `depth` (h, w); and
optionally `colour`, either (h', w', 3) uint8 RGB or the bytes (n,) of a PNG or JPEG; `X_WC` (4, 4),
the camera's pose in the world; `header`, a JSON object with `depth_unit` (metres per integer),
`camera` (the fields of `Camera`), `colour_registered`. Other arrays are ignored.
"""

import dataclasses
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError, InsufficientViewError
from unwrinkle.models.io.archive import archive_members, load_archive, save_archive
from unwrinkle.models.io.loader_yaml import load_yaml
from unwrinkle.models.transforms import PoseRecord, check_pose
from unwrinkle.perception.camera import Camera, load_camera

#: Camera of a depth file that does not name one.
_log = logging.getLogger(__name__)

DEFAULT_CAMERA = "xtion-pro-live"

#: Largest fraction of pixels without a reading.
_MAX_HOLE_FRACTION = 0.5

#: Limits of a plausible median depth, metres.
_MIN_DEPTH_M = 0.1
_MAX_DEPTH_M = 10.0


@dataclass(frozen=True, eq=False)
class Capture:
    """Depth image of a garment with its camera.

    Attributes:
        depth: (h, w) float32, metres along the optical axis; 0 for no reading.
        camera: intrinsics of the depth image.
        colour: (h', w', 3) uint8 RGB, or None.
        colour_registered: whether colour and depth share pixels.
        X_WC: (4, 4) pose of the camera in the world, or None if unknown.
        name: for messages and output files.

    Raises:
        InputError: wrong shapes, an empty depth image, implausible depths, or a pose that is not a
            rigid transform.
        InsufficientViewError: most pixels have no reading.
    """

    depth: NDArray[np.float32]
    camera: Camera
    colour: NDArray[np.uint8] | None = None
    colour_registered: bool = False
    X_WC: NDArray[np.float64] | None = None
    name: str = "capture"

    def __post_init__(self) -> None:
        """Check and copy the arrays and make them read-only."""
        depth = np.array(self.depth, dtype=np.float32)
        wanted = (self.camera.height, self.camera.width)
        if depth.shape != wanted:
            raise InputError(
                f"{self.name}: depth has shape {depth.shape}, camera {self.camera.name!r} has "
                f"{wanted} (rows, columns); name the right --camera"
            )
        if np.isnan(depth).all():
            raise InputError(f"{self.name}: depth is all NaN; record it again")
        depth[~np.isfinite(depth)] = 0.0
        if (depth < 0.0).any():
            raise InputError(f"{self.name}: depth has negative readings; wanted metres, 0 for none")
        if not depth.any():
            raise InputError(f"{self.name}: depth is all zero (no reading); record it again")
        middle = float(np.median(depth[depth > 0.0]))
        if not _MIN_DEPTH_M <= middle <= _MAX_DEPTH_M:
            raise InputError(
                f"{self.name}: the median depth is {middle:.4g} m, wanted {_MIN_DEPTH_M} to "
                f"{_MAX_DEPTH_M:.0f} m; floats are read as metres, integers as millimetres"
            )
        holes = float(np.mean(depth == 0.0))
        if holes > _MAX_HOLE_FRACTION:
            raise InsufficientViewError(
                f"{self.name}: insufficient view, {holes:.0%} of the depth image has no reading, "
                f"at most {_MAX_HOLE_FRACTION:.0%} may lack; look again"
            )
        depth.setflags(write=False)
        object.__setattr__(self, "depth", depth)
        if self.colour is not None:
            colour = np.array(self.colour)
            if colour.ndim != 3 or colour.shape[2] != 3 or colour.dtype != np.uint8:
                raise InputError(
                    f"{self.name}: colour is {colour.dtype} {colour.shape}, wanted uint8 (h, w, 3)"
                )
            if self.colour_registered and colour.shape[:2] != depth.shape:
                raise InputError(
                    f"{self.name}: colour {colour.shape[:2]} cannot be registered to depth "
                    f"{depth.shape}; the sizes differ"
                )
            colour.setflags(write=False)
            object.__setattr__(self, "colour", colour)
        if self.X_WC is not None:
            pose = np.array(self.X_WC, dtype=float)
            check_pose(pose, f"{self.name}, camera in the world")
            pose.setflags(write=False)
            object.__setattr__(self, "X_WC", pose)


def load_capture(
    path: str | Path,
    camera: str | Path | Camera | None = None,
    colour: str | Path | None = None,
    *,
    colour_registered: bool | None = None,
    pose: str | Path | NDArray[np.float64] | None = None,
) -> Capture:
    """Read a capture from a depth file.

    Args:
        path: `.png`, `.npy` or `.npz`; see the module docstring.
        camera: a name, a YAML file or a `Camera`; None for the file's own, or DEFAULT_CAMERA.
        colour: an image file; None searches beside the depth file (`*_depth_mm.png` ->
            `*_rgb.jpg` or `.png`, CTU's `cloD*` -> `cloC*`).
        colour_registered: whether colour and depth share pixels; None for the value in the file, or
            False without one (equal size does not imply equal view).
        pose: X_WC, a (4, 4) array or a YAML file with `translation` and `rotation` (rows).

    Raises:
        InputError: a file or value cannot be used; the message names the file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the name or the folder")
    header: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    suffix = path.suffix.lower()
    if suffix == ".png":
        raw = _read_png_depth(path)
    elif suffix == ".npy":
        raw = _read_npy(path)
    elif suffix == ".npz":
        header, arrays = load_archive(path, "depth|colour|X_WC")
        if "depth" not in arrays:
            names = ", ".join(archive_members(path)) or "none"
            raise InputError(f"{path}: has no array 'depth' (it has {names})")
        raw = arrays["depth"]
    else:
        raise InputError(f"{path}: depth must be .png, .npy or .npz, not {suffix or 'nameless'}")
    depth = _metres(raw, header.get("depth_unit", 0.001), path)
    chosen = _camera_of(camera, header, path)
    image, registered = _colour_of(path, colour, arrays, header)
    if colour_registered is not None:
        registered = colour_registered
    X_WC = _pose_of(pose, arrays)
    return Capture(depth, chosen, image, registered, X_WC, str(path))


def save_capture(
    path: str | Path, capture: Capture, *, depth_unit: float = 0.001, jpeg_quality: int = 92
) -> None:
    """Write a capture to one `.npz`: depth as uint16 in `depth_unit` metres, colour as JPEG.

    Raises:
        InputError: a depth exceeds 65535 units, or the file cannot be written.
    """
    units = np.rint(np.asarray(capture.depth, dtype=float) / depth_unit)
    if units.max() > 65535:
        raise InputError(f"{path}: {capture.depth.max():.2f} m does not fit units of {depth_unit}")
    arrays: dict[str, NDArray[Any]] = {"depth": units.astype(np.uint16)}
    if capture.colour is not None:
        bgr = cv2.cvtColor(capture.colour, cv2.COLOR_RGB2BGR)
        done, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
        if not done:
            raise InputError(f"{path}: colour cannot be encoded")
        arrays["colour"] = np.asarray(encoded, dtype=np.uint8).ravel()
    if capture.X_WC is not None:
        arrays["X_WC"] = capture.X_WC
    header = {
        "depth_unit": depth_unit,
        "camera": dataclasses.asdict(capture.camera),
        "colour_registered": capture.colour_registered,
    }
    save_archive(path, header, arrays)


def _read_png_depth(path: Path) -> NDArray[Any]:
    encoded = path.read_bytes()
    image = None
    # OpenCV pads a truncated PNG with zeros; require its last chunk.
    if encoded.endswith(b"IEND\xaeB`\x82"):
        image = cv2.imdecode(np.frombuffer(encoded, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path}: is no PNG or is truncated; copy or record it again")
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(
            f"{path}: is {image.dtype} {image.shape}, wanted one channel of uint16 millimetres; "
            "is it a colour image?"
        )
    return image


def _read_npy(path: Path) -> NDArray[Any]:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        raise InputError(
            f"{path}: cannot be read as .npy (damaged, truncated, or pickled objects); copy or "
            "record it again"
        ) from None
    return np.asarray(array)


def _metres(raw: NDArray[Any], unit: Any, path: Path) -> NDArray[np.float32]:
    if raw.ndim != 2:
        raise InputError(f"{path}: depth has shape {raw.shape}, wanted (rows, columns)")
    if np.issubdtype(raw.dtype, np.integer):
        if not isinstance(unit, int | float) or not 0.0 < unit <= 0.1:
            raise InputError(f"{path}: depth_unit {unit!r} must be metres per unit, over 0")
        return (raw.astype(np.float64) * unit).astype(np.float32)
    if np.issubdtype(raw.dtype, np.floating):
        return raw.astype(np.float32)
    raise InputError(f"{path}: depth is {raw.dtype}, wanted integers (mm) or floats (m)")


def _camera_of(camera: str | Path | Camera | None, header: Mapping[str, Any], path: Path) -> Camera:
    if isinstance(camera, Camera):
        return camera
    if camera is not None:
        return load_camera(camera)
    if "camera" in header:
        try:
            return Camera(**header["camera"])
        except TypeError as error:
            raise InputError(f"{path}: its camera does not fit ({error})") from None
    _log.warning("%s: no camera was given; %s is assumed", path, DEFAULT_CAMERA)
    return load_camera(DEFAULT_CAMERA)


def _colour_beside(path: Path) -> Path | None:
    name = path.name
    candidates: list[str] = []
    if "_depth_mm." in name:
        stem = name.split("_depth_mm.")[0]
        candidates = [f"{stem}_rgb{suffix}" for suffix in (".jpg", ".png")]
    elif name.startswith("cloD"):
        candidates = ["cloC" + name[4:]]
    for candidate in candidates:
        if (path.parent / candidate).is_file():
            return path.parent / candidate
    return None


def _colour_of(
    path: Path, colour: str | Path | None, arrays: dict[str, NDArray[Any]], header: dict[str, Any]
) -> tuple[NDArray[np.uint8] | None, bool]:
    beside = Path(colour) if colour is not None else _colour_beside(path)
    if beside is not None:
        if not beside.is_file():
            raise InputError(f"{beside}: no such colour file; check the name or leave it out")
        return _decoded(np.fromfile(beside, dtype=np.uint8), beside), False
    if "colour" not in arrays:
        return None, False
    stored = arrays["colour"]
    image = _decoded(stored, path) if stored.ndim == 1 else stored
    return image, bool(header.get("colour_registered", False))


def _decoded(encoded: NDArray[Any], path: Path) -> NDArray[np.uint8]:
    image = None
    if encoded.dtype == np.uint8 and encoded.size:
        image = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path}: its colour is no readable image; record it again")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _pose_of(
    pose: str | Path | NDArray[np.float64] | None, arrays: dict[str, NDArray[Any]]
) -> NDArray[np.float64] | None:
    if pose is None:
        return arrays.get("X_WC")
    if isinstance(pose, np.ndarray):
        return pose
    return load_yaml(Path(pose), PoseRecord).matrix(str(pose))
