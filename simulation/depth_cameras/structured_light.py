"""Structured light (Kinect v1, Xtion): depth from the disparity of a projected pattern.

A window of the infrared picture is matched with the pattern. Hence everything that such a camera
does: steps of equal disparity, noise that is alike over a window, no reading where the pattern does
not fall or where it is too distorted to be matched, and the edges of the surface that fills most of
the window.
"""

import dataclasses as dc
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.depth_cameras._base import DepthCameraModel, incidence

Image = NDArray[np.float64]

_BAND_WIDTHS = (0.6, 1.4)  # of the mean one
_EDGE_SIZE = 2.0  # px, sigma over which an edge wanders alike


@dataclass(frozen=True)
class StructuredLightCamera(DepthCameraModel):
    """A camera and a projector of dots, side by side.

    Attributes:
        baseline: projector's x in the camera frame, metres; it looks where the camera looks.
        inverse_step: step of inverse depth, 1/m; steps are (z^2 inverse_step) apart in depth.
        depth_unit: readings are whole multiples of this, metres.
        window: side of the matched window, pixels, odd.
        matched: least share of a window that must be lit and belong to one surface.
        agreement: pixels of one surface differ by less from the window's own, steps.
        steepest: largest angle from square on, to camera and projector, that is matched, degrees.
        window_noise: standard deviation of the noise that is alike over a window, steps.
        blotch_noise, blotch_size: of the slow noise, steps, and its sigma, pixels.
        angle_noise: with angle t from square on noise grows by 1 + this * t^2 / (pi/2 - t)^2.
        edge_noise: standard deviation of an edge's place, pixels.
        bow: steps of the specimen's bias at the image's ends: of u^2, u v and v^2, u, v in -1..1.
        band_width, band_spread: mean width of its vertical bands, pixels, and standard deviation of
            the bias at a band's either end, steps; between its ends it is linear.
        blind_columns: at the image's left, never measured.
        unit: seed of the specimen's bands.

    Raises:
        InputError: as `DepthCameraModel`; a window that is even, or a share beyond 1.
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
        """Refuse what no such camera is."""
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
        """The camera, wider to the right: what is there can keep the projector's light away."""
        return dc.replace(self.camera, width=self.camera.width + self._margin)

    def measured(self, ideal: NDArray[np.floating[Any]], seed: int) -> NDArray[np.float32]:
        """Depth from matching; see `DepthCameraModel.measured`."""
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
        """Where the projector's light falls, (h, w) bool, by what the camera sees of the scene.

        Seen from the projector a point is shifted to the left by its disparity. Points that the
        camera sees in one order and the projector in the other cannot both be lit: the farther
        one, which is the left one, lies in the shadow.
        """
        seen = depth > 0.0
        disparity = self.camera.fx * self.baseline / np.where(seen, depth, np.inf)
        place = np.where(seen, np.arange(depth.shape[1]) - disparity, np.inf)
        right = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(seen & (place <= right))

    def specimen_bias(self) -> Image:
        """Bias (h, w) of this specimen, steps: a bow over the image, and vertical bands."""
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
        """Columns by which the nearest things can throw their shadow to the left."""
        return ceil(self.camera.fx * self.baseline / self.nearest)

    def _noise(self, cosine: Image, rng: np.random.Generator) -> Image:
        white = rng.standard_normal(cosine.shape)
        alike = cv2.boxFilter(white, -1, (self.window, self.window)) * self.window
        slow = cv2.GaussianBlur(rng.standard_normal(cosine.shape), (0, 0), self.blotch_size)
        slow *= 2.0 * np.sqrt(np.pi) * self.blotch_size  # the blur's loss
        angle = np.arccos(np.clip(cosine, 0.0, 1.0))
        angle = np.minimum(angle, np.radians(self.steepest))
        growth = 1.0 + self.angle_noise * (angle / (0.5 * np.pi - angle)) ** 2
        return np.asarray(growth * (self.window_noise * alike + self.blotch_noise * slow))

    def _wandering(self, steps: Image, rng: np.random.Generator) -> Image:
        """Steps with edges that wander; smooth surfaces stay as they are."""
        rows, columns = np.indices(steps.shape)
        scale = 2.0 * np.sqrt(np.pi) * _EDGE_SIZE * self.edge_noise
        for index, last in ((rows, steps.shape[0] - 1), (columns, steps.shape[1] - 1)):
            shift = cv2.GaussianBlur(rng.standard_normal(steps.shape), (0, 0), _EDGE_SIZE)
            index += np.rint(scale * shift).astype(index.dtype)
            np.clip(index, 0, last, out=index)
        moved = steps[rows, columns]
        same = np.abs(moved - steps) <= self.agreement
        return np.where(same, steps, moved)


@numba.njit(cache=True, parallel=True)
def _matched(steps: Image, half: int, share: float, agreement: float) -> Image:
    """Mean over the window of the surface that fills most of it; NaN where none fills the share.

    The pixel's own surface comes first, then those at the middles of the window's sides.
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
