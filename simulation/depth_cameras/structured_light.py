"""Structured-light depth cameras (Kinect v1, Xtion): depth from the disparity of a pattern.

A window of the infrared image is matched with the projected pattern. This causes the errors of such
cameras: quantisation in disparity, noise correlated over a window, no reading in the projector's
shadow or where the pattern is too distorted, and edges of the surface that fills most of the
window.
"""

import dataclasses as dc
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.depth_cameras._base import DepthCameraModel, incidence

Image = NDArray[np.float64]

#: Range of a vertical band's width, multiples of the mean width.
_BAND_WIDTHS = (0.6, 1.4)

#: Sigma of the spatial correlation of edge shifts, pixels.
_EDGE_SIGMA_PX = 2.0


@dataclass(frozen=True)
class StructuredLightCamera(DepthCameraModel):
    """Camera and dot projector side by side.

    Attributes:
        baseline: x of the projector in the camera frame, metres; its axis is parallel to the
            camera's.
        inverse_step: quantisation step of inverse depth, 1/m; the depth step is z^2 inverse_step.
        depth_unit: readings are multiples of this, metres.
        window: side of the matching window, pixels, odd.
        matched: least fraction of a window that is lit and belongs to one surface.
        agreement: largest difference within one surface, steps.
        steepest: largest incidence angle, to camera and projector, of a match, degrees.
        window_noise: standard deviation of the noise correlated over a window, steps.
        blotch_noise, blotch_size: standard deviation, steps, and sigma, pixels, of the
            low-frequency noise.
        angle_noise: growth of the noise by 1 + angle_noise * t^2 / (pi/2 - t)^2 at incidence angle
            t.
        edge_noise: standard deviation of an edge's position, pixels.
        bow: bias of the individual sensor, steps: coefficients of u^2, u v and v^2, u, v in -1..1.
        band_width, band_spread: mean width of the vertical bands, pixels, and standard deviation of
            the bias at either end of a band, steps; it is linear in between.
        blind_columns: number of columns without readings at the image's left.
        unit: seed of the individual sensor's bands.

    Raises:
        InputError: as `DepthCameraModel`; or a parameter is out of range.
    """

    baseline: float = 0.075
    inverse_step: float = 0.002925
    depth_unit: float = 0.001
    window: int = 9
    matched: float = 0.5
    agreement: float = 3.0
    steepest: float = 75.0
    window_noise: float = 0.48
    blotch_noise: float = 0.36
    blotch_size: float = 20.0
    angle_noise: float = 0.053
    edge_noise: float = 0.8
    bow: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    band_width: float = 75.0
    band_spread: float = 0.5
    blind_columns: int = 7
    unit: int = 1

    def __post_init__(self) -> None:
        """Check the range of the parameters."""
        super().__post_init__()
        if self.window % 2 == 0 or not 1 <= self.window <= 31:
            raise self._refusal(f"window = {self.window} must be odd, 1 to 31 pixels")
        if not 0.0 < self.matched <= 1.0 or not self.steepest < 90.0:
            raise self._refusal(
                f"matched = {self.matched} must be over 0 to 1, steepest = {self.steepest} below 90"
            )
        if min(self.inverse_step, self.depth_unit, self.blotch_size) <= 0.0:
            raise self._refusal("inverse_step, depth_unit and blotch_size must be positive")
        if self.band_width < 8.0 or self.blind_columns >= self.camera.width:
            raise self._refusal("band_width must be 8 px or more, blind_columns within the image")
        if len(self.bow) != 3 or not np.isfinite(self.bow).all():
            raise self._refusal(f"bow = {self.bow} must be three finite numbers")

    @property
    def ideal_camera(self) -> Camera:
        """The camera, extended to the right: objects there can shadow the projector."""
        return dc.replace(self.camera, width=self.camera.width + self._margin)

    def measured(self, ideal: NDArray[np.floating[Any]], seed: int) -> NDArray[np.float32]:
        """Simulate the reading; see `DepthCameraModel.measured`."""
        depth = self._exact(ideal)
        width = self.camera.width
        usable = self.lit(depth) & (depth >= self.nearest) & (depth <= self.farthest)
        cosine = np.minimum(
            incidence(depth, self.ideal_camera),
            incidence(depth, self.ideal_camera, self.baseline),
        )
        usable &= cosine > np.cos(np.radians(self.steepest))
        inverse = np.divide(1.0, depth, out=np.full_like(depth, np.nan), where=usable)
        steps = (inverse / self.inverse_step)[:, :width]
        rng = np.random.default_rng(seed)
        steps = _matched(steps, self.window // 2, self.matched, self.agreement)
        steps = self._wandering(steps, rng)
        whole = np.rint(steps + self.specimen_bias() + self._noise(cosine[:, :width], rng))
        whole[:, : self.blind_columns] = np.nan
        found = np.isfinite(whole) & (whole > 0.0)
        reading = 1.0 / (np.where(found, whole, 1.0) * self.inverse_step)
        reading = np.rint(reading / self.depth_unit) * self.depth_unit
        found &= (reading >= self.nearest) & (reading <= self.farthest)
        return np.where(found, reading, 0.0).astype(np.float32)

    def lit(self, depth: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask (h, w) of lit pixels, by the exact depth image (h, w), metres.

        From the projector, a point is shifted to the left by its disparity. If two points appear in
        opposite order to camera and projector, the farther (left) one is in the shadow.
        """
        seen = depth > 0.0
        disparity = self.camera.fx * self.baseline / np.where(seen, depth, np.inf)
        place = np.where(seen, np.arange(depth.shape[1]) - disparity, np.inf)
        right = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(seen & (place <= right))

    def specimen_bias(self) -> Image:
        """Return the bias (h, w) of the individual sensor, steps: a bow and vertical bands."""
        v, u = (np.linspace(-1.0, 1.0, n) for n in (self.camera.height, self.camera.width))
        across, mixed, down = self.bow
        bias = across * u**2 + mixed * np.outer(v, u) + down * v[:, None] ** 2
        rng = np.random.default_rng(self.unit)
        left = -float(rng.uniform(0.0, self.band_width))
        while left < self.camera.width:
            right = left + self.band_width * float(rng.uniform(*_BAND_WIDTHS))
            ends = rng.normal(0.0, self.band_spread, 2)
            columns = np.arange(max(0, ceil(left)), min(self.camera.width, ceil(right)))
            bias[:, columns] += np.interp(columns, (left, right), ends)
            left = right
        return np.asarray(bias)

    @property
    def _margin(self) -> int:
        """Largest width of a shadow, columns."""
        return ceil(self.camera.fx * self.baseline / self.nearest)

    def _noise(self, cosine: Image, rng: np.random.Generator) -> Image:
        white = rng.standard_normal(cosine.shape)
        alike = cv2.boxFilter(white, -1, (self.window, self.window)) * self.window
        slow = cv2.GaussianBlur(rng.standard_normal(cosine.shape), (0, 0), self.blotch_size)
        slow *= (
            2.0 * np.sqrt(np.pi) * self.blotch_size
        )  # restores the standard deviation after the blur
        angle = np.arccos(np.clip(cosine, 0.0, 1.0))
        angle = np.minimum(angle, np.radians(self.steepest))
        growth = 1.0 + self.angle_noise * (angle / (0.5 * np.pi - angle)) ** 2
        return np.asarray(growth * (self.window_noise * alike + self.blotch_noise * slow))

    def _wandering(self, steps: Image, rng: np.random.Generator) -> Image:
        """Shift the edges at random; smooth surfaces are unchanged."""
        rows, columns = np.indices(steps.shape)
        scale = 2.0 * np.sqrt(np.pi) * _EDGE_SIGMA_PX * self.edge_noise
        for index, last in ((rows, steps.shape[0] - 1), (columns, steps.shape[1] - 1)):
            shift = cv2.GaussianBlur(rng.standard_normal(steps.shape), (0, 0), _EDGE_SIGMA_PX)
            index += np.rint(scale * shift).astype(index.dtype)
            np.clip(index, 0, last, out=index)
        moved = steps[rows, columns]
        same = np.abs(moved - steps) <= self.agreement
        return np.where(same, steps, moved)


@njit(parallel=True)
def _matched(steps: Image, half: int, share: float, agreement: float) -> Image:
    """Return the mean over each window of its largest surface; NaN below the least share.

    Candidates are the surfaces at the pixel itself and at the middles of the window's sides.
    """
    rows, columns = steps.shape
    result = np.full((rows, columns), np.nan)
    for i in numba.prange(rows):
        for j in range(columns):
            top, below = max(0, i - half), min(rows, i + half + 1)
            left, right = max(0, j - half), min(columns, j + half + 1)
            area = (below - top) * (right - left)
            most, mean = 0, 0.0
            for side in range(5):
                own = steps[i, j]
                if side == 1:
                    own = steps[top, j]
                elif side == 2:
                    own = steps[below - 1, j]
                elif side == 3:
                    own = steps[i, left]
                elif side == 4:
                    own = steps[i, right - 1]
                if np.isnan(own):
                    continue
                count, total = 0, 0.0
                for k in range(top, below):
                    for m in range(left, right):
                        away = steps[k, m] - own
                        if abs(away) <= agreement:
                            count += 1
                            total += away
                if count > most:
                    most, mean = count, own + total / count
                if side == 0 and 2 * count > area:
                    break
            if most >= share * area:
                result[i, j] = mean
    return result
