"""Wrinkledness: entropy of the surface normals around a point, and the best grasp point by it.

A. Ramisa et al., "Using depth and appearance features for informed robot grasping of highly
wrinkled clothes", ICRA 2012: entropy of the joint histogram of inclination and azimuth of the
normals in a 33 x 33 window. The paper does not state the bins; here 8 x 8, natural logarithm.

Two additions: on flat cloth the azimuth is noise, so normals of small inclination share one bin;
and because concave spots, which fingers cannot pinch, have as much entropy as ridges, the grasp
point maximises the entropy times the convex part of the mean curvature.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.surface import Surface

#: Histogram bins of inclination (0 to pi/2) and azimuth (0 to 2 pi).
BINS = (8, 8)

#: Side of the window, cells.
WINDOW = 33

#: Label of cells without a normal.
_NO_BIN = 255

#: Least fraction of a window on the garment for its centre to be a grasp point.
_MIN_GARMENT_FRACTION = 0.6


@dataclass(frozen=True, eq=False)
class Wrinkledness:
    """Entropy of the normals on a grid, and the grasp point.

    Attributes:
        entropy: (ny, nx) float32, nats; 0 outside.
        score: (ny, nx) float32, entropy times max(0, -mean curvature), nats/m.
        point: (2,) world x, y of the best score, or None where nothing is convex.
        resolution: metres between samples.
        origin: (2,) world x, y of sample [0, 0].
    """

    entropy: NDArray[np.float32]
    score: NDArray[np.float32]
    point: NDArray[np.float64] | None
    resolution: float
    origin: NDArray[np.float64]


def normal_bins(
    zx: NDArray[np.floating[Any]],
    zy: NDArray[np.floating[Any]],
    inside: NDArray[np.bool_],
    *,
    flat_inclination: float = 0.0524,
    bins: tuple[int, int] = BINS,
) -> NDArray[np.uint8]:
    """Return the histogram bin of each normal (-zx, -zy, 1), 255 outside.

    Args:
        zx, zy: (ny, nx) slopes.
        inside: (ny, nx) bool, which normals count.
        flat_inclination: radians; normals that tilt less all go to bin 0.
        bins: numbers of inclination and azimuth bins; their product is at most 255.

    Raises:
        InputError: too many bins.
    """
    if bins[0] * bins[1] > _NO_BIN:
        raise InputError(f"wrinkledness: {bins[0]} x {bins[1]} bins, at most {_NO_BIN} in all")
    zx32 = np.ascontiguousarray(zx, dtype=np.float32)
    zy32 = np.ascontiguousarray(zy, dtype=np.float32)
    slope = cv2.magnitude(zx32, zy32)
    azimuth = cv2.phase(-zx32, -zy32)
    # Compare slopes with the tangents of the bounds: cheaper than arctan of every slope.
    bounds = np.tan(np.arange(1, bins[0]) * (0.5 * np.pi / bins[0])).astype(np.float32)
    inclined = np.zeros(slope.shape, dtype=np.uint8)
    for bound in bounds:
        inclined += slope >= bound
    turned = np.minimum((azimuth * (bins[1] / (2.0 * np.pi))).astype(np.uint8), bins[1] - 1)
    labels = inclined * np.uint8(bins[1]) + turned.astype(np.uint8)
    labels[slope < np.float32(np.tan(flat_inclination))] = 0
    labels[~inside] = _NO_BIN
    result: NDArray[np.uint8] = labels
    return result


def window_entropy(labels: NDArray[np.uint8], window: int = WINDOW) -> NDArray[np.float32]:
    """Return the entropy, nats, of the labels in the window around each cell; 255 is ignored.

    H = log N - sum(n log n) / N over the bins' counts n: one box filter per bin that occurs.

    Args:
        labels: (ny, nx) uint8.
        window: odd side of the window, cells, at most 255 (counts are kept in 16 bits).

    Raises:
        InputError: an even or too wide window.
    """
    if window % 2 == 0 or not 1 <= window <= 255:
        raise InputError(f"wrinkledness: window of {window} cells, wanted an odd number to 255")
    table = np.arange(window * window + 1, dtype=np.float64)
    table[1:] *= np.log(table[1:])
    table32 = table.astype(np.float32)
    total = np.zeros(labels.shape, dtype=np.float32)
    counted = np.zeros(labels.shape, dtype=np.uint16)
    size = (window, window)
    for label in np.flatnonzero(np.bincount(labels.ravel(), minlength=256)[:_NO_BIN]):
        mask = cv2.compare(labels, float(label), cv2.CMP_EQ)
        cv2.bitwise_and(mask, 1.0, dst=mask)
        counts = cv2.boxFilter(
            mask, cv2.CV_16U, size, normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        total += table32.take(counts)
        counted += np.asarray(counts, dtype=np.uint16)
    number = np.maximum(counted, 1).astype(np.float32)
    entropy = np.maximum(np.log(number) - total / number, 0.0)
    result: NDArray[np.float32] = entropy.astype(np.float32)
    return result


def wrinkledness(surface: Surface, profile: NoiseProfile) -> Wrinkledness:
    """Compute the entropy of the normals over the garment's surface, and the grasp point."""
    cells = int(np.clip(round(profile.wrinkledness_window / surface.resolution), 3, 255))
    window = cells | 1 if cells < 255 else 255
    labels = normal_bins(
        surface.zx, surface.zy, surface.inside, flat_inclination=profile.flat_inclination
    )
    entropy = window_entropy(labels, window)
    entropy[~surface.inside] = 0.0
    # Curvatures are positive where concave (z up).
    convex = np.maximum(0.0, -0.5 * (surface.k_max + surface.k_min)).astype(np.float32)
    score = entropy * convex
    share = cv2.boxFilter(
        surface.inside.astype(np.float32), -1, (window, window), borderType=cv2.BORDER_CONSTANT
    )
    score[~surface.inside | (np.asarray(share) < _MIN_GARMENT_FRACTION)] = 0.0
    score[~np.isfinite(score)] = 0.0
    point = None
    if score.max() > 0.0:
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        point = np.asarray(surface.origin) + surface.resolution * np.array([column, row])
    return Wrinkledness(entropy, score, point, surface.resolution, surface.origin)
