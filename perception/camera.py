"""Pinhole cameras: intrinsics by name or from YAML, projection and unprojection.

Camera frame C: x right, y down, z forward (OpenCV). The centre of the top left pixel is (0, 0).
"""

from dataclasses import dataclass, field, replace
from math import atan, degrees, isfinite
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir

#: Limits of a plausible field of view, degrees.
_MAX_VIEW_DEG = 150.0
_MIN_VIEW_DEG = 2.0


@dataclass(frozen=True)
class Camera:
    """Pinhole intrinsics with OpenCV's distortion model.

    Attributes:
        name: of the camera, for messages.
        width, height: image size, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        distortion: k1, k2, p1, p2, k3; empty for none.
        sensor: name of the noise profile of its depth readings.

    Raises:
        InputError: a size or focal length is not positive, a number is not finite, the principal
            point lies far outside the image (a crop's may lie outside), or the field of view is
            below 2 or above 150 degrees.
    """

    name: str = ""
    width: int = 0
    height: int = 0
    fx: float = 0.0
    fy: float = 0.0
    cx: float = 0.0
    cy: float = 0.0
    distortion: list[float] = field(default_factory=list)
    sensor: str = "xtion"

    def __post_init__(self) -> None:
        """Check that the intrinsics are plausible."""
        label = f"camera {self.name!r}"
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not all(isfinite(number) for number in numbers):
            raise InputError(f"{label}: intrinsics {numbers} must be finite; calibrate again")
        if self.width < 2 or self.height < 2:
            raise InputError(f"{label}: image size {self.width} x {self.height} is no image size")
        if self.fx <= 0.0 or self.fy <= 0.0:
            raise InputError(f"{label}: focal length fx {self.fx}, fy {self.fy} must be positive")
        if len(self.distortion) not in (0, 4, 5):
            raise InputError(f"{label}: distortion needs k1, k2, p1, p2[, k3] or nothing")
        for axis, size, focal, centre in (
            ("x", self.width, self.fx, self.cx),
            ("y", self.height, self.fy, self.cy),
        ):
            if not -0.5 * size <= centre <= 1.5 * size:
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
    """Load a camera by its name in the package or from a YAML file.

    Raises:
        InputError: unknown name, missing file, unknown key, absurd intrinsics, or a principal
            point outside the image.
    """
    if str(name) in camera_names():
        return load_yaml(models_dir() / "cameras" / f"{name}.yaml", Camera)
    path = Path(name)
    if path.suffix.lower() in (".yaml", ".yml"):
        camera = load_yaml(path, Camera)
        for axis, size, centre in (
            ("x", camera.width, camera.cx),
            ("y", camera.height, camera.cy),
        ):
            if not -0.5 <= centre <= size - 0.5:
                raise InputError(
                    f"{path}: principal point c{axis} = {centre} lies outside the image "
                    f"of {size} pixels; are the intrinsics of another resolution?"
                )
        return camera
    raise InputError(
        f"camera {str(name)!r}: unknown; known are {', '.join(camera_names())}, or give a .yaml"
    )
