"""Pinhole cameras: intrinsics by name or from YAML, projection and unprojection.

Camera frame C: x right, y down, z forward (OpenCV). The centre of the top left pixel is (0, 0).
"""

import logging
from dataclasses import dataclass, field, replace
from math import atan, degrees, isfinite, nan
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
from unwrinkle.models.io.pose_file import pose_of
from unwrinkle.perception.camera_formats import ENDINGS, EXAMPLE, WANTED, camera_fields, numbers
from unwrinkle.perception.sensor import noise_profile_names

_log = logging.getLogger(__name__)

#: Limits of a plausible field of view, degrees.
_MAX_VIEW_DEG = 150.0
_MIN_VIEW_DEG = 2.0

#: Largest distance of a file's principal point from the middle of the image, fraction of the side.
_MAX_OFF_CENTRE = 0.09

#: Largest distance of a colour camera from its depth camera, metres.
_MAX_BASELINE_M = 0.5

#: Largest ratio of fx and fy in a file.
_MAX_ASPECT = 1.1


@dataclass(frozen=True)
class Camera:
    """Pinhole intrinsics with OpenCV's distortion model.

    Attributes:
        name: of the camera, for messages.
        width, height: image size, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        distortion: k1, k2, p1, p2, k3; empty for none.
        sensor: name of the noise profile of its depth readings.
        crop: of an image that was cut out of a larger one: left, top, full width, full height,
            pixels; empty for a whole image. The intrinsics are those of the smaller image.

    Raises:
        InputError: a size or focal length is not positive, a number is missing or not finite, the
            principal point lies far outside the image (a crop's may lie outside), or the field of
            view is below 2 or above 150 degrees.
    """

    name: str = ""
    width: int = 0
    height: int = 0
    fx: float = nan
    fy: float = nan
    cx: float = nan
    cy: float = nan
    distortion: list[float] = field(default_factory=list)
    sensor: str = "xtion"
    crop: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Check that the intrinsics are plausible."""
        label = f"camera {self.name!r}"
        if not all(isfinite(number) for number in self.distortion):
            raise InputError(f"{label}: distortion {self.distortion} must be finite")
        if self.width < 2 or self.height < 2:
            raise InputError(f"{label}: image size {self.width} x {self.height} is no image size")
        intrinsics = {key: getattr(self, key) for key in ("fx", "fy", "cx", "cy")}
        if absent := [key for key, value in intrinsics.items() if not isfinite(value)]:
            raise InputError(
                f"{label}: {', '.join(absent)} missing or not finite; give fx, fy, cx and cy in "
                "pixels of the image"
            )
        if self.fx <= 0.0 or self.fy <= 0.0:
            raise InputError(f"{label}: focal length fx {self.fx}, fy {self.fy} must be positive")
        if len(self.distortion) not in (0, 4, 5):
            raise InputError(f"{label}: distortion needs k1, k2, p1, p2[, k3] or nothing")
        if self.crop:
            self._check_crop(label)
        for axis, size, focal, centre in (
            ("x", self.width, self.fx, self.cx),
            ("y", self.height, self.fy, self.cy),
        ):
            if not self.crop and not -0.5 * size <= centre <= 1.5 * size:
                raise InputError(
                    f"{label}: principal point c{axis} = {centre} lies far outside the image "
                    f"of {size} pixels; are the intrinsics of another resolution?"
                )
            view = degrees(2.0 * atan(0.5 * size / focal))
            if not _MIN_VIEW_DEG <= view <= _MAX_VIEW_DEG:
                raise InputError(
                    f"{label}: f{axis} = {focal} gives a field of view of {view:.1f} degrees, "
                    f"wanted {_MIN_VIEW_DEG:.0f} to {_MAX_VIEW_DEG:.0f}; is it in pixels?"
                )

    def _check_crop(self, label: str) -> None:
        whole = self.crop[2:]
        inside = len(self.crop) == 4 and all(
            first >= 0 and first + size <= full
            for first, size, full in zip(
                self.crop[:2], (self.width, self.height), whole, strict=True
            )
        )
        if not inside:
            raise InputError(
                f"{label}: crop {self.crop} needs left, top, full width, full height around the "
                f"image of {self.width} x {self.height}"
            )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The 3 x 3 intrinsic matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def scaled(self, factor: float) -> "Camera":
        """Return the camera of the image resized by a factor (0.5 halves it).

        Pixel centres are preserved: cx becomes (cx + 0.5) * factor - 0.5.

        Raises:
            InputError: the factor leaves no image.
        """
        return replace(
            self,
            width=round(self.width * factor),
            height=round(self.height * factor),
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
            crop=[],
        )

    def window(self, left: int, top: int, width: int, height: int) -> "Camera":
        """Return the camera of a window of the image, which begins at pixel (left, top)."""
        first = self.crop or [0, 0, self.width, self.height]
        return replace(
            self,
            width=width,
            height=height,
            cx=self.cx - left,
            cy=self.cy - top,
            crop=[first[0] + left, first[1] + top, *first[2:]],
        )

    def rays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y, both (height, width), of the undistorted rays (x, y, 1) of all pixels."""
        u, v = np.arange(self.width, dtype=float), np.arange(self.height, dtype=float)
        if not any(self.distortion):
            x, y = np.meshgrid((u - self.cx) / self.fx, (v - self.cy) / self.fy)
            return x, y
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
        undistorted = cv2.undistortPoints(pixels, self.matrix, np.array(self.distortion))
        grid = np.asarray(undistorted, dtype=float).reshape(self.height, self.width, 2)
        return grid[..., 0], grid[..., 1]

    def unproject(
        self, pixels: NDArray[np.floating[Any]], depth: NDArray[np.floating[Any]] | float
    ) -> NDArray[np.float64]:
        """Return the camera-frame points (..., 3), metres, of pixels at a depth.

        Args:
            pixels: (..., 2) u, v.
            depth: metres along the optical axis, one for each pixel or one for all.
        """
        pixels = np.asarray(pixels, dtype=float)
        if any(self.distortion):
            distorted = pixels.reshape(-1, 1, 2)
            ideal = cv2.undistortPoints(distorted, self.matrix, np.array(self.distortion))
            rays = np.asarray(ideal, dtype=float).reshape(pixels.shape)
        else:
            rays = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        z = np.broadcast_to(np.asarray(depth, dtype=float), rays.shape[:-1])
        return np.stack([rays[..., 0] * z, rays[..., 1] * z, z], axis=-1)

    def unproject_image(self, depth: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the camera-frame points (height, width, 3), metres, of a depth image."""
        x, y = self.rays()
        return np.stack([x * depth, y * depth, depth], axis=-1)

    def project(self, points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the pixels u, v (..., 2) of camera-frame points (..., 3), metres."""
        points = np.asarray(points, dtype=float)
        if not any(self.distortion):
            scaled = points[..., :2] / points[..., 2:]
            return scaled * [self.fx, self.fy] + [self.cx, self.cy]
        pixels, _ = cv2.projectPoints(
            points.reshape(-1, 1, 3),
            np.zeros(3),
            np.zeros(3),
            self.matrix,
            np.array(self.distortion),
        )
        return np.asarray(pixels, dtype=float).reshape(*points.shape[:-1], 2)


def camera_names() -> tuple[str, ...]:
    """Return the names of the cameras that the package ships."""
    return tuple(sorted(path.stem for path in (models_dir() / "cameras").glob("*.yaml")))


def load_camera(name: str | Path) -> Camera:
    """Load a camera by its name in the package or from a file.

    Files are YAML with the fields of `Camera`, or of another program; see `camera_formats`.

    Raises:
        InputError: unknown name, missing file, unknown or missing key, absurd intrinsics, an
            unknown noise profile, or intrinsics that are those of another resolution; see
            `check_intrinsics`.
    """
    if str(name) in camera_names():
        return load_yaml(models_dir() / "cameras" / f"{name}.yaml", Camera)
    path = Path(name)
    if path.suffix.lower() not in ENDINGS:
        raise InputError(
            f"camera {str(name)!r}: unknown; known are {', '.join(camera_names())}, or give a file "
            f"({', '.join(ENDINGS)})"
        )
    fields, own = camera_fields(path)
    own = own and fields.pop("colour", None) is None
    if absent := [key for key in WANTED if key not in fields]:
        raise InputError(f"{path}: {', '.join(absent)} missing; wanted e.g. {EXAMPLE}")
    if own and not _nested(fields.get("distortion")):
        camera = load_yaml(path, Camera)
    else:
        try:
            camera = Camera(**fields | {"distortion": numbers(fields.get("distortion", []))})
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if "sensor" not in fields:
            _log.warning(
                "%s: names no noise profile; %s is assumed, --sensor chooses another",
                path,
                camera.sensor,
            )
    check_intrinsics(camera, str(path))
    return camera


def load_colour_camera(name: str | Path) -> tuple[Camera, Pose] | None:
    """Load the colour camera that a depth camera's file describes under `colour`.

    Its keys are those of a camera, and `pose`: the colour camera in the depth camera's frame.

    Returns:
        The camera and X_DC (4, 4); None for a file without one, and for a camera by name.

    Raises:
        InputError: a key is missing, or a value cannot be used; the message names the file.
    """
    path = Path(name)
    if str(name) in camera_names() or path.suffix.lower() not in ENDINGS:
        return None
    fields = camera_fields(path)[0].get("colour")
    if fields is None:
        return None
    label = f"{path}: colour"
    known = (*WANTED, "name", "distortion", "pose")
    if not isinstance(fields, dict) or not set(fields) <= set(known):
        raise InputError(f"{label} needs the keys {', '.join((*WANTED, 'pose'))}")
    if absent := [key for key in (*WANTED, "pose") if key not in fields]:
        raise InputError(f"{label}: {', '.join(absent)} missing")
    X_DC = pose_of(fields["pose"], f"{label}: pose")
    values = {key: value for key, value in fields.items() if key != "pose"}
    try:
        camera = Camera(**values | {"distortion": numbers(values.get("distortion", []))})
    except (InputError, TypeError) as error:
        raise InputError(f"{label}: {error}") from None
    check_intrinsics(camera, label)
    if float(np.linalg.norm(X_DC[:3, 3])) > _MAX_BASELINE_M:
        raise InputError(
            f"{label}: its camera is {np.linalg.norm(X_DC[:3, 3]):.2f} m from the depth camera, at "
            f"most {_MAX_BASELINE_M} m are plausible; write the translation in metres"
        )
    return camera, X_DC


def check_intrinsics(camera: Camera, name: str) -> None:
    """Refuse intrinsics that do not fit the size of their image, and unknown noise profiles.

    The principal point of a whole image lies near its middle: within 0.08 of the side in the few
    calibrated cameras that were looked at. Intrinsics of another common resolution miss it by 0.1
    (640 x 400 of 640 x 480) to 0.5 (doubled).

    Args:
        camera: as read from a file.
        name: of the file, for messages.

    Raises:
        InputError: the principal point is too far from the middle of an image that is no declared
            crop, fx and fy are too different, or there is no such noise profile.
    """
    left, top, *whole = camera.crop or [0, 0, camera.width, camera.height]
    for axis, size, centre in (
        ("x", whole[0], camera.cx + left),
        ("y", whole[1], camera.cy + top),
    ):
        off = centre - 0.5 * (size - 1)
        if abs(off) > _MAX_OFF_CENTRE * size:
            raise InputError(
                f"{name}: principal point c{axis} = {centre:g} lies {abs(off):.0f} pixels from "
                f"the middle of an image of {size} pixels, at most {_MAX_OFF_CENTRE * size:.0f} "
                f"are plausible; {_off_centre_cause(centre, size)}"
            )
    if not 1.0 / _MAX_ASPECT <= camera.fx / camera.fy <= _MAX_ASPECT:
        raise InputError(
            f"{name}: fx {camera.fx:g} and fy {camera.fy:g} differ by more than "
            f"{_MAX_ASPECT - 1.0:.0%}, but pixels are square; are they of one resolution?"
        )
    if camera.sensor not in noise_profile_names():
        raise InputError(
            f"{name}: sensor {camera.sensor!r} is no noise profile; known are "
            f"{', '.join(noise_profile_names())}"
        )


def _nested(value: Any) -> bool:
    """Return whether coefficients are a list of lists, as numpy and OpenCV write them."""
    return isinstance(value, list) and any(isinstance(item, list) for item in value)


def _off_centre_cause(centre: float, size: int) -> str:
    """Return what is likely wrong with a principal point, and the cure."""
    if -1.0 <= centre <= 1.0:
        return (
            "0 or a fraction is no principal point, give it in pixels (or is it of another "
            "resolution?)"
        )
    return (
        f"the intrinsics are of another resolution (of {round(2.0 * centre + 1.0)} pixels?), scale "
        "them to the image; of an image cut out of a larger one write crop: [left, top, full "
        "width, full height]"
    )
