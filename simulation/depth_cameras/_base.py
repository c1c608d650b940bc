"""What all models of depth cameras share: range, camera, and the angle that light meets a surface."""

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
    """A depth camera.

    Attributes:
        name: of the model.
        camera: pinhole intrinsics of the depth image, without distortion.
        nearest, farthest: depths along the optical axis between which there are readings, metres.

    Raises:
        InputError: a number is not finite or negative, the range is empty, or the camera distorts.
    """

    name: str = ""
    camera: Camera = field(default_factory=lambda: Camera("pinhole", 640, 480, 525, 525, 320, 240))
    nearest: float = 0.5
    farthest: float = 4.0

    def __post_init__(self) -> None:
        """Refuse what no camera is."""
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
        """The `near` that a `Renderer` needs for this camera: what is nearer does not hide things.

        Its default of 0.40 m lets a camera look through all that is nearer.
        """
        return 0.5 * self.nearest

    @property
    @abstractmethod
    def ideal_camera(self) -> Camera:
        """The camera of the exact depth image that `measured` starts from."""

    @abstractmethod
    def measured(self, ideal: NDArray[np.floating[Any]], seed: int) -> NDArray[np.float32]:
        """What the sensor makes of exact depth.

        Args:
            ideal: depth as `ideal_camera` sees it, metres, 0 where nothing is.
            seed: of this look's noise; the specimen's own faults stay.

        Returns:
            (h, w) depth of `camera`, metres; 0 where there is no reading, never NaN.

        Raises:
            InputError: the shape is not that of `ideal_camera`.
        """

    def _refusal(self, text: str) -> InputError:
        return InputError(f"depth camera {self.name!r}: {text}")

    def _exact(self, ideal: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """The exact depth as floats, nothing where it is not finite."""
        wanted = (self.ideal_camera.height, self.ideal_camera.width)
        if ideal.shape != wanted:
            raise self._refusal(
                f"exact depth has shape {ideal.shape}, wanted {wanted} of its ideal_camera"
            )
        return np.where(np.isfinite(ideal) & (ideal > 0.0), ideal, 0.0).astype(np.float64)


def incidence(
    depth: NDArray[np.float64], camera: Camera, source: float = 0.0
) -> NDArray[np.float64]:
    """Cosine (h, w) of the angle between the surface's normal and the ray from a source.

    The inverse depth of a plane is linear in the ray (x, y, 1), so its slopes give the normal
    exactly. Of the slopes to either neighbour the gentler counts: edges are no steep faces.

    Args:
        depth: (h, w) metres, 0 where nothing is seen.
        camera: its pinhole.
        source: x of the light's source in the camera frame, metres; 0 is the camera itself.

    Returns:
        1 is square on; 0 where nothing is seen.
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
    # A surface seen by the camera turns its back to the source where the sign is the other one.
    cosine = np.divide(dot, length, out=np.zeros_like(dot), where=seen & (length > 0.0))
    return np.clip(np.nan_to_num(cosine), 0.0, 1.0)


def _gentler(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """The smaller difference to the neighbours along an axis; 0 where there is none."""
    steps = np.diff(values, axis=axis)
    end = np.full_like(np.take(values, [0], axis=axis), np.nan)
    before = np.concatenate([end, steps], axis=axis)
    after = np.concatenate([steps, end], axis=axis)
    first = ~np.isfinite(after) | (np.abs(before) < np.abs(after))
    return np.nan_to_num(np.where(first, before, after))
