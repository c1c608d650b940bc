"""Cross-section profiles of a ridge: from the crest to the contour and the foot, on one side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.ridges import Line
from unwrinkle.perception.wrinkles.surface import Floats, Surface, sample

#: Slope (rise over run) below which the cross-section has reached the wrinkle's foot.
FOOT_SLOPE = 0.05

#: Search limit of the foot, multiples of the contour's distance (4 sigma of a Gaussian ridge).
FOOT_REACH = 4.0


class CrossSectionSide:
    """Cross-sections of a surface from the ridge to one side; arrays (samples, steps).

    The profiles are averaged along the ridge to reduce noise; averaging across it would widen and
    lower the wrinkle.

    Attributes:
        points: (samples, steps, 2) on the surface's grid.
        distance: (steps,) from the ridge, metres.
        z: heights above the table, metres.
        found: (samples,) whether the contour was found and the foot stands on the garment.
        contour: (samples,) fractional step of the inflection (sign change of the curvature).
        foot: (samples,) fractional step of the foot.
    """

    def __init__(
        self,
        curve: Line,
        across: Line,
        surface: Surface,
        profile: NoiseProfile,
        *,
        fine: bool,
    ) -> None:
        """Sample the surface from `curve` along `across`, both (samples, 2), in cells.

        Args:
            curve: points of the ridge line.
            across: its unit normals, towards the sampled side.
            surface: the fitted surface.
            profile: the sensor's profile.
            fine: sample the less smoothed surface, averaged along the ridge.
        """
        reach = profile.contour_reach / surface.resolution
        steps = np.arange(0.0, 2.0 * reach, 0.5)
        self.points = curve[:, None, :] + across[:, None, :] * steps[:, None]
        self.distance = steps * surface.resolution
        grids: tuple[Floats, ...] = (surface.z, surface.zxx, surface.zxy, surface.zyy)
        z, zxx, zxy, zyy = surface.fine if fine else grids
        nx, ny = across[:, :1], across[:, 1:]
        self.z = sample(z, self.points)
        bend = sample(zxx, self.points) * (nx * nx)
        bend += sample(zxy, self.points) * (2.0 * nx * ny)
        bend += sample(zyy, self.points) * (ny * ny)
        if fine and profile.averaging > 0.0:
            sigma = profile.averaging / profile.triplet_spacing
            self.z = gaussian_filter1d(self.z, sigma, axis=0, mode="nearest")
            bend = gaussian_filter1d(bend, sigma, axis=0, mode="nearest")
        step = np.diff(self.z, axis=1)
        run = np.diff(self.distance)
        self._arc = np.concatenate(
            [np.zeros((len(curve), 1)), np.cumsum(np.hypot(step, run), axis=1)], axis=1
        )
        outside = sample(surface.inside.astype(np.float32), self.points) < 0.5
        beyond = np.logical_or.accumulate(outside, axis=1)
        # Contour: sign change of the curvature across the ridge, to a fraction of a step.
        concave = (bend >= 0.0) & (self.distance <= profile.contour_reach)
        k = np.argmax(concave, axis=1)
        rows = np.arange(len(curve))
        self.found = concave.any(axis=1) & (k > 0) & ~beyond[rows, k]
        before, after = bend[rows, np.maximum(k - 1, 0)], bend[rows, k]
        fraction = np.clip(before / np.where(self.found, before - after, 1.0), 0.0, 1.0)
        self.contour = np.where(self.found, np.maximum(k - 1, 0) + fraction, 0.0)
        # Foot: first gentle step beyond the contour, or the search limit; if the cloth ends before,
        # this is the garment's rim and not a wrinkle.
        gentle = step / run > -FOOT_SLOPE
        index = np.arange(gentle.shape[1])
        past = index >= np.ceil(self.contour)[:, None]
        far = index >= FOOT_REACH * np.maximum(self.contour, 1.0)[:, None]
        stop = (past & gentle) | far
        stop[:, -1] = True
        foot = np.argmax(stop, axis=1)
        self.found &= ~beyond[rows, foot]
        self.foot = np.maximum(foot.astype(float), self.contour)

    def at(
        self, where: NDArray[np.float64]
    ) -> tuple[Line, NDArray[np.float64], NDArray[np.float64]]:
        """Interpolate points (n, 2) in cells, heights and arc lengths from the ridge, metres."""
        low = np.clip(where.astype(int), 0, self.z.shape[1] - 2)
        part, rows = where - low, np.arange(len(where))

        def mix(values: NDArray[Any]) -> NDArray[Any]:
            weight = part if values.ndim == 2 else part[:, None]
            return values[rows, low] * (1.0 - weight) + values[rows, low + 1] * weight

        return mix(self.points), mix(self.z), mix(self._arc)
