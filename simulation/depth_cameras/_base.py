"""Base of the depth camera models: range, intrinsics, and the incidence angle of light."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera


@dataclass(frozen=True)
class DepthCameraModel(ABC):
    """Depth camera model.

    Attributes:
        name: of the model.
        camera: pinhole intrinsics of the depth image, without distortion.
        nearest, farthest: least and largest depth of a reading along the optical axis, metres.

    Raises:
        InputError: a number is not finite or negative, the range is empty, or the camera has
            distortion.
    """

    name: str = ""
    camera: Camera = field(default_factory=lambda: Camera("pinhole", 640, 480, 525, 525, 320, 240))
    nearest: float = 0.5
    farthest: float = 4.0

    def __post_init__(self) -> None:
        """Check the range of the parameters."""
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float | int) and not (isfinite(value) and value >= 0.0):
                raise self._refusal(f"{item.name} = {value} must be finite and not negative")
        if not 0.0 < self.nearest < self.farthest:
            raise self._refusal(f"range {self.nearest} to {self.farthest} m is empty")
        if any(self.camera.distortion):
            raise self._refusal("its camera has distortion; the renderer has none, leave it out")

    @property
    def near_plane(self) -> float:
        """Near clipping plane that a `Renderer` needs for this camera, metres.

        Objects nearer than the renderer's near plane (0.40 m by default) are invisible and do not
        occlude the scene.
        """
        return 0.5 * self.nearest

    @property
    @abstractmethod
    def ideal_camera(self) -> Camera:
        """Camera of the exact depth image that `measured` takes."""

    @abstractmethod
    def measured(self, ideal: NDArray[np.floating[Any]], seed: int) -> NDArray[np.float32]:
        """Simulate the sensor's reading of an exact depth image.

        Args:
            ideal: exact depth image of `ideal_camera`, metres; 0 for none.
            seed: of the noise of this image; the errors of the individual sensor are fixed.

        Returns:
            Depth (h, w) of `camera`, metres; 0 without a reading, never NaN.

        Raises:
            InputError: the shape differs from that of `ideal_camera`.
        """

    def _refusal(self, text: str) -> InputError:
        return InputError(f"depth camera {self.name!r}: {text}")

    def _exact(self, ideal: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the exact depth as floats; 0 where it is not finite."""
        wanted = (self.ideal_camera.height, self.ideal_camera.width)
        if ideal.shape != wanted:
            raise self._refusal(
                f"exact depth has shape {ideal.shape}, wanted {wanted} of its ideal_camera"
            )
        return np.where(np.isfinite(ideal) & (ideal > 0.0), ideal, 0.0).astype(np.float64)


def incidence(
    depth: NDArray[np.float64], camera: Camera, source: float = 0.0
) -> NDArray[np.float64]:
    """Return the cosine (h, w) of the angle between surface normal and the ray from a source.

    The inverse depth of a plane is linear in the ray (x, y, 1), so that its slopes give the exact
    normal. The smaller of the slopes to both neighbours is used, because depth edges are not steep
    faces.

    Args:
        depth: (h, w) metres, 0 for none.
        camera: pinhole camera of the depth image.
        source: x of the light source in the camera frame, metres; 0 for the camera itself.

    Returns:
        1 for perpendicular incidence; 0 where there is no depth.
    """
    seen = depth > 0.0
    inverse = np.where(seen, 1.0 / np.where(seen, depth, 1.0), np.nan)
    x, y = camera.rays()
    slope_x = camera.fx * _gentler(inverse, axis=1)
    slope_y = camera.fy * _gentler(inverse, axis=0)
    along = inverse - x * slope_x - y * slope_y
    ray_x = x - source * inverse
    dot = slope_x * ray_x + slope_y * y + along
    length = np.sqrt((slope_x**2 + slope_y**2 + along**2) * (ray_x**2 + y**2 + 1.0))
    # A negative sign means that a surface seen by the camera faces away from the source.
    cosine = np.divide(dot, length, out=np.zeros_like(dot), where=seen & (length > 0.0))
    return np.clip(np.nan_to_num(cosine), 0.0, 1.0)


def _gentler(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return the smaller difference to the neighbours along an axis; 0 without any."""
    steps = np.diff(values, axis=axis)
    end = np.full_like(np.take(values, [0], axis=axis), np.nan)
    before = np.concatenate([end, steps], axis=axis)
    after = np.concatenate([steps, end], axis=axis)
    first = ~np.isfinite(after) | (np.abs(before) < np.abs(after))
    return np.nan_to_num(np.where(first, before, after))
