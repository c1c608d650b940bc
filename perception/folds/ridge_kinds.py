"""Ridges that are no wrinkles: borders of layers and bulges of stacks.

A wrinkle stands on the lowest cloth around it and comes down to the same level on both sides. The
upper side of a border does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from unwrinkle.perception.folds.height_image import HeightImage, Points
from unwrinkle.perception.folds.settings import FoldSettings
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle


class RidgeKind(StrEnum):
    """What a ridge is."""

    WRINKLE = "wrinkle"
    BORDER = "layer border"
    BULGE = "stack bulge"


#: How far the cross-sections reach, and where the levels beside the ridge are taken, metres.
_REACH_M = 0.06
_LOW_REACH_M = 0.05
_LEVEL_M = (0.015, 0.030)
_SLOPE_REACH_M = 0.030

#: A fine sensor's border: differences of the falls, or of the levels, to both sides, metres.
_MOST_FALL_DIFFERENCE_M = 0.002
_MOST_LEVEL_STEP_M = 0.005

#: A coarse sensor's border is where the score 2.18 + 0.21 fall difference - 0.17 level step
#: + 0.08 upper level - 4.3 slope ratio - 0.1 fall ratio, lengths in millimetres, is above 0: a
#: logistic regression on wrinkles of simulated and real Xtion images.
_OFFSET = 2.18
_PER_FALL_DIFFERENCE_MM = 0.21
_PER_LEVEL_STEP_MM = -0.17
_PER_UPPER_LEVEL_MM = 0.08
_PER_SLOPE_RATIO = -4.3
_PER_FALL_RATIO = -0.1


@dataclass(frozen=True)
class RidgeProfile:
    """Medians over a ridge's cross-sections. Lengths in metres.

    Attributes:
        fall_difference: between the falls to the lowest cloth on either side.
        fall_ratio: of the smaller fall to the larger.
        level_step: between the levels at 15 to 30 mm on either side.
        upper_level: the higher of them, over the garment's lowest cloth.
        slope_ratio: of the smaller of the greatest slopes on either side to the larger.
    """

    fall_difference: float
    fall_ratio: float
    level_step: float
    upper_level: float
    slope_ratio: float


def ridge_kind(image: HeightImage, settings: FoldSettings, wrinkle: Wrinkle) -> RidgeKind:
    """Say whether a ridge is a wrinkle, the border of a layer or a bulge of a stack of layers."""
    profile = ridge_profile(image, settings, wrinkle)
    if settings.fine:
        border = (
            profile.fall_difference > _MOST_FALL_DIFFERENCE_M
            or profile.level_step > _MOST_LEVEL_STEP_M
        )
    else:
        score = (
            _OFFSET
            + 1e3 * _PER_FALL_DIFFERENCE_MM * profile.fall_difference
            + 1e3 * _PER_LEVEL_STEP_MM * profile.level_step
            + 1e3 * _PER_UPPER_LEVEL_MM * profile.upper_level
            + _PER_SLOPE_RATIO * profile.slope_ratio
            + _PER_FALL_RATIO * profile.fall_ratio
        )
        border = score > 0.0
    if border:
        return RidgeKind.BORDER
    if wrinkle.length < settings.bulge_length and profile.upper_level > settings.bulge_level:
        return RidgeKind.BULGE
    return RidgeKind.WRINKLE


def ridge_profile(image: HeightImage, settings: FoldSettings, wrinkle: Wrinkle) -> RidgeProfile:
    """Measure the cross-sections of a ridge."""
    z = image.smoothed(settings.smoothing)
    base = float(np.percentile(z[image.garment], 20.0))
    cells = image.cells(wrinkle.curve[:, :2])
    tangents = np.gradient(cells, axis=0)
    tangents /= np.maximum(np.hypot(*tangents.T)[:, None], 1e-9)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    distance = np.arange(0.0, _REACH_M + 1e-9, image.resolution)
    sides = [_side(image, z, cells, sign * normals, distance) for sign in (1.0, -1.0)]
    levels = [_mean(*side, (distance >= _LEVEL_M[0]) & (distance <= _LEVEL_M[1])) for side in sides]
    crest = sides[0][0][:, 0]
    lows = [
        np.where(on & (distance <= _LOW_REACH_M), heights, np.inf).min(axis=1)
        for heights, on in sides
    ]
    falls = [crest - low for low in lows]
    smaller, larger = np.minimum(*falls), np.maximum(*falls)
    count = max(1, round(_SLOPE_REACH_M / image.resolution))
    slopes = [
        np.abs(np.diff(heights, axis=1))[:, :count].max(axis=1) / image.resolution
        for heights, _ in sides
    ]
    return RidgeProfile(
        fall_difference=abs(float(np.median(falls[0] - falls[1]))),
        fall_ratio=float(np.median(smaller / np.maximum(larger, 1e-3))),
        level_step=abs(_median(levels[0] - levels[1])),
        upper_level=_median(np.fmax(*levels)) - base
        if np.isfinite(np.fmax(*levels)).any()
        else 0.0,
        slope_ratio=float(np.median(np.minimum(*slopes) / np.maximum(np.maximum(*slopes), 1e-3))),
    )


def _side(
    image: HeightImage,
    z: NDArray[np.float32],
    cells: Points,
    normals: Points,
    distance: Points,
) -> tuple[Points, NDArray[np.bool_]]:
    """Return heights (samples, steps) of the cross-sections to one side, and what is garment."""
    points = cells[:, None] + (distance / image.resolution)[:, None] * normals[:, None]
    rows, columns = points[..., 1], points[..., 0]
    heights = map_coordinates(z, [rows, columns], order=1, mode="nearest")
    inside = map_coordinates(
        image.garment.astype(np.float32), [rows, columns], order=1, mode="constant"
    )
    return heights.astype(float), np.logical_and.accumulate(inside > 0.5, axis=1)


def _mean(heights: Points, on: NDArray[np.bool_], within: NDArray[np.bool_]) -> Points:
    """Return the mean heights (samples,) within a window; NaN where it is not garment."""
    use = on & within
    count = use.sum(axis=1)
    return np.asarray(
        np.where(count >= 2, np.where(use, heights, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    )


def _median(values: Points) -> float:
    """Return the median of the finite values, 0 if there is none."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else 0.0
