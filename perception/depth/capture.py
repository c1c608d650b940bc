"""Depth captures: depth image and camera, optionally colour and camera pose; file formats.

Depth files: `.png` of uint16 millimetres; `.npy`; `.npz`. Integers are millimetres, floats metres,
unless a unit is given. No reading: 0, NaN, infinity, the type's largest integer (65535), one
negative value (-1), and everything beyond 10 m. Keys of an `.npz`: `depth` (h, w); and optionally
`colour`, either (h', w', 3) uint8 RGB or the bytes (n,) of a PNG or JPEG; `X_WC` (4, 4), the
camera's pose in the world; `header`, a JSON object with `depth_unit` (metres per integer), `camera`
(the fields of `Camera`), `colour_registered`. The unit may also be called as other programs do, see
`depth_units`. Other keys and arrays are refused: one that is not read may change the meaning.
"""

import dataclasses
import difflib
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError, InsufficientViewError
from unwrinkle.models.io.archive import archive_members, load_archive, save_archive
from unwrinkle.models.io.images import decoded_images
from unwrinkle.models.io.pose_file import load_pose
from unwrinkle.models.transforms import check_translation, nearest_pose
from unwrinkle.perception.camera import Camera, check_intrinsics, load_camera, load_colour_camera
from unwrinkle.perception.depth.color_registration import registered_colour
from unwrinkle.perception.depth.depth_units import UNIT_KEYS, depth_in_metres, stated_unit

_log = logging.getLogger(__name__)

#: Camera of a depth file that does not name one.
DEFAULT_CAMERA = "xtion-pro-live"

#: Arrays of an `.npz`, and keys of its header, without those of the unit.
_ARRAYS = ("depth", "colour", "X_WC")
_HEADER_KEYS = ("camera", "colour_registered")

#: Largest fraction of pixels without a reading.
_MAX_HOLE_FRACTION = 0.5

#: Limits of a plausible median depth, metres.
_MIN_DEPTH_M = 0.1
_MAX_DEPTH_M = 10.0

_UNITS = (
    "; floats are read as metres, integers as millimetres; another unit is given in metres, e.g. "
    "--depth-unit 0.0001"
)


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
        garment_at: column and row of a pixel on the garment, where several objects lie in view.

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
    garment_at: tuple[float, float] | None = None

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
        depth[depth >= _MAX_DEPTH_M] = 0.0
        negative = np.unique(depth[depth < 0.0])
        if negative.size > 1 or (negative.size and not (depth > 0.0).any()):
            raise InputError(f"{self.name}: depth has negative readings; wanted metres, 0 for none")
        depth[depth < 0.0] = 0.0  # one value: a sign for no reading
        if not depth.any():
            raise InputError(
                f"{self.name}: depth is all zero or beyond {_MAX_DEPTH_M:.0f} m (no reading); "
                f"record it again{_UNITS}"
            )
        middle = float(np.median(depth[depth > 0.0]))
        if not _MIN_DEPTH_M <= middle <= _MAX_DEPTH_M:
            raise InputError(
                f"{self.name}: the median depth is {middle:.4g} m, wanted {_MIN_DEPTH_M} to "
                f"{_MAX_DEPTH_M:.0f} m{_UNITS}"
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
            pose = np.array(nearest_pose(pose, f"{self.name}, camera in the world"))
            check_translation(pose[:3, 3], f"{self.name}, camera in the world")
            pose.setflags(write=False)
            object.__setattr__(self, "X_WC", pose)


def load_capture(
    path: str | Path,
    camera: str | Path | Camera | None = None,
    colour: str | Path | None = None,
    *,
    colour_registered: bool | None = None,
    pose: str | Path | NDArray[np.float64] | None = None,
    depth_unit: float | None = None,
) -> Capture:
    """Read a capture from a depth file.

    Args:
        path: `.png`, `.npy` or `.npz`; see the module docstring.
        camera: a name, a YAML file or a `Camera`; None for the file's own, or DEFAULT_CAMERA.
        colour: an image file; None searches beside the depth file (`*_depth_mm.png` ->
            `*_rgb.jpg` or `.png`, CTU's `cloD*` -> `cloC*`).
        colour_registered: whether colour and depth share pixels; None for the value in the file, or
            False without one (equal size does not imply equal view).
        pose: X_WC, a (4, 4) array or a file, see `models.io.pose_file`.
        depth_unit: metres per unit of the stored numbers; None for the file's own, or millimetres
            for integers and metres for floats.

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
        header, arrays = _read_npz(path)
        raw = arrays["depth"]
    else:
        raise InputError(f"{path}: depth must be .png, .npy or .npz, not {suffix or 'nameless'}")
    depth = depth_in_metres(raw, depth_unit, stated_unit(header, path), path)
    chosen = _camera_of(camera, header, path)
    image, registered = _colour_of(path, colour, arrays, header)
    if colour_registered is not None:
        registered = colour_registered
    X_WC = _pose_of(pose, arrays)
    capture = Capture(depth, chosen, image, registered, X_WC, str(path))
    beside = None if camera is None or isinstance(camera, Camera) else load_colour_camera(camera)
    if beside is None or capture.colour is None or capture.colour_registered:
        return capture
    colour_camera, X_DC = beside
    wanted = (colour_camera.height, colour_camera.width)
    if capture.colour.shape[:2] != wanted:
        raise InputError(
            f"{path}: its colour image is {capture.colour.shape[:2]} (rows, columns), the colour "
            f"camera of {camera} has {wanted}; give both of one resolution"
        )
    seen = registered_colour(capture.colour, capture.depth, chosen, colour_camera, X_DC)
    return dataclasses.replace(capture, colour=seen, colour_registered=True)


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


def _read_npz(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of an archive.

    Raises:
        InputError: it has no depth, or a key or an array that is not read.
    """
    header, arrays = load_archive(path, "|".join((*_ARRAYS, *UNIT_KEYS)))
    names = archive_members(path)
    if "depth" not in arrays:
        raise InputError(f"{path}: has no array 'depth' (it has {', '.join(names) or 'none'})")
    for name in UNIT_KEYS:  # a number beside the depth is a key of the header
        if name in arrays:
            if arrays[name].size != 1 or name in header:
                raise InputError(f"{path}: array {name!r} is no depth unit, or given twice")
            header[name] = arrays.pop(name).item()
    _refuse_unknown(path, "array", names, (*_ARRAYS, *UNIT_KEYS))
    _refuse_unknown(path, "header key", header, (*_HEADER_KEYS, *UNIT_KEYS))
    return header, arrays


def _refuse_unknown(path: Path, what: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"read are {', '.join(known)}"
            raise InputError(
                f"{path}: {what} {name!r} is not read and may change the meaning; rename it or "
                f"leave it out ({hint})"
            )


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


def _camera_of(camera: str | Path | Camera | None, header: Mapping[str, Any], path: Path) -> Camera:
    if isinstance(camera, Camera):
        return camera
    if camera is not None:
        return load_camera(camera)
    if "camera" in header:
        try:
            stored = Camera(**header["camera"])
        except TypeError as error:
            raise InputError(f"{path}: its camera does not fit ({error})") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        check_intrinsics(stored, str(path))
        return stored
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
    image = decoded_images([encoded])[0] if encoded.dtype == np.uint8 else None
    if image is None:
        raise InputError(f"{path}: its colour is no readable image; record it again")
    return image


def _pose_of(
    pose: str | Path | NDArray[np.float64] | None, arrays: dict[str, NDArray[Any]]
) -> NDArray[np.float64] | None:
    if pose is None:
        return arrays.get("X_WC")
    if isinstance(pose, np.ndarray):
        return pose
    return load_pose(pose)
