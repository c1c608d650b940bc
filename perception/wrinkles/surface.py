"""Garment surface: B-spline fit, principal curvatures, shape index and shape classes.

Heights are z up, so that ridge, dome and cap have a positive shape index (Koenderink 1990):
S = -(2/pi) atan2(k1 + k2, k1 - k2) with k1 >= k2 (cup -1, rut -0.5, ridge +0.5, cap +1). The form
S = (2/pi) atan((k2 + k1) / (k2 - k1)) of the source paper is undefined at umbilics and changes sign
with the normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.bspline import TensorSpline, fit_spline
from unwrinkle.perception.wrinkles.hole_filling import fill_holes

Floats = NDArray[np.float32]
Labels = NDArray[np.uint8]

_Scalar = TypeVar("_Scalar", bound=np.generic)

FLAT, CUP, TROUGH, RUT, SADDLE_RUT, SADDLE, SADDLE_RIDGE, RIDGE, DOME, CAP = range(10)

CLASS_NAMES = (
    "flat",
    "cup",
    "trough",
    "rut",
    "saddle rut",
    "saddle",
    "saddle ridge",
    "ridge",
    "dome",
    "cap",
)

#: Class boundaries on the shape index (Koenderink; the source paper gives none).
CLASS_BOUNDS = (-7 / 8, -5 / 8, -3 / 8, -1 / 8, 1 / 8, 3 / 8, 5 / 8, 7 / 8)

#: Samples of the surface per knot spacing; the spline resolves nothing finer.
SAMPLES_PER_KNOT = 6

#: Largest distance between samples of the surface, metres.
COARSEST_SAMPLE = 0.001

#: Width of the garment's rim that is not fitted, in knot spacings: there depth readings mix cloth
#: and table, and the cloth's edge comes down to the table.
RIM_SPANS = 0.25

#: Lower bound of that width, metres.
RIM_LEAST = 0.003


@dataclass(frozen=True, eq=False)
class Surface:
    """Fitted surface of a garment, sampled on a grid. All arrays are (ny, nx).

    Attributes:
        z: height above the table, m.
        zx, zy: slopes along world x and y.
        zxx, zxy, zyy: second derivatives, 1/m.
        garment: the garment's mask.
        inside: garment cells with measurements nearby (no extrapolation).
        k_max, k_min: principal curvatures, 1/m, positive where concave (z up).
        shape_index: [-1, 1].
        classes: uint8, 0 flat, 1 cup ... 9 cap, majority-filtered; 0 outside.
        resolution: metres between samples.
        origin: (2,) world x, y of sample [0, 0].
        spline: the fitted spline; its coordinates start at `origin`.
        fine: z, zxx, zxy, zyy of the less smoothed surface on which wrinkles are measured; the same
            arrays if the profile's two smoothing lengths are equal.
    """

    z: Floats
    zx: Floats
    zy: Floats
    zxx: Floats
    zxy: Floats
    zyy: Floats
    garment: Mask
    inside: Mask
    k_max: Floats
    k_min: Floats
    shape_index: Floats
    classes: Labels
    resolution: float
    origin: NDArray[np.float64]
    spline: TensorSpline
    fine: tuple[Floats, Floats, Floats, Floats]

    def world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the world x, y, metres, of (column, row) points (..., 2)."""
        return self.origin + self.resolution * np.asarray(points, dtype=float)

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fractional (column, row) of world points (..., 2), metres."""
        return (np.asarray(points, dtype=float) - self.origin) / self.resolution


def principal_curvatures(
    zx: Floats, zy: Floats, zxx: Floats, zxy: Floats, zyy: Floats
) -> tuple[Floats, Floats]:
    """Return the principal curvatures k1 >= k2 of z(x, y), 1/m; k2 is negative on a ridge (z up).

    H^2 - K is clamped at 0 before the root because rounding makes it slightly negative.
    """
    a, b = 1.0 + zx * zx, 1.0 + zy * zy
    g = a + b - 1.0
    mean = (b * zxx + a * zyy - 2.0 * zx * zy * zxy) / (2.0 * g * np.sqrt(g))
    gauss = (zxx * zyy - zxy * zxy) / (g * g)
    root = np.sqrt(np.maximum(mean * mean - gauss, 0.0))
    return mean + root, mean - root


def shape_index(k_max: Floats, k_min: Floats) -> Floats:
    """Return the shape index -(2/pi) atan2(k1 + k2, k1 - k2): cup -1, ridge 0.5, cap 1."""
    index = np.arctan2(k_max + k_min, k_max - k_min)
    index *= np.float32(-2.0 / np.pi)
    return index


def curvedness(k_max: Floats, k_min: Floats) -> Floats:
    """Return Koenderink's curvedness sqrt((k1^2 + k2^2) / 2), 1/m."""
    return np.sqrt(0.5 * (k_max * k_max + k_min * k_min))


def classify(index: Floats, curved: Floats, flat: float) -> Labels:
    """Return the shape classes 1 (cup) to 9 (cap), 0 where the curvedness is below `flat`, 1/m."""
    classes = ((index + np.float32(1.125)) * np.float32(4.0)).astype(np.uint8)
    classes += 1
    np.clip(classes, CUP, CAP, out=classes)
    classes[curved < flat] = FLAT
    return classes


def majority_filter(classes: Labels, radius: int) -> Labels:
    """Return the most frequent class in each (2 * radius + 1)^2 window, the lowest on ties.

    Raises:
        InputError: radius < 0 or a window of more than 65535 cells.
    """
    side = 2 * radius + 1
    if radius < 0 or side * side > 65535:
        raise InputError(f"majority filter: radius {radius} must be in 0..127 cells")
    if radius == 0:
        return classes.copy()
    winner = np.zeros_like(classes)
    most = np.zeros(classes.shape, dtype=np.float32)
    for label in np.flatnonzero(np.bincount(classes.ravel(), minlength=CAP + 1)):
        hits = (classes == label).view(np.uint8)
        count = cv2.boxFilter(hits, cv2.CV_32F, (side, side), normalize=False)
        more = cv2.compare(count, most, cv2.CMP_GT)
        cv2.copyTo(np.full_like(winner, label), more, winner)
        cv2.max(most, count, most)
    return winner


def crest_direction(zxx: Floats, zxy: Floats, zyy: Floats) -> tuple[Floats, Floats]:
    """Return the unit (x, y) across a crest: the Hessian's eigenvector of the least eigenvalue."""
    angle = 0.5 * np.arctan2(2.0 * zxy, zxx - zyy)
    return -np.sin(angle), np.cos(angle)


def fit_surface(range_map: RangeMap, profile: NoiseProfile, *, patches: bool = False) -> Surface:
    """Fit the garment's surface and classify its shape.

    Garment cells on the rim are left out, because the step from cloth to table is not part of the
    surface. The grid has SAMPLES_PER_KNOT samples per knot spacing, or the range map's own cells if
    those are coarser.

    Args:
        range_map: heights above the table.
        profile: the sensor's noise profile.
        patches: fit the source paper's independent patches instead of one surface.

    Raises:
        InputError: no garment, or no measured cell on it away from the rim.
    """
    rows, columns, stride = _window(range_map, profile)
    weight, height, garment = _binned(range_map, rows, columns, stride, profile)
    resolution = range_map.resolution * stride
    if not np.any(weight > 0.0):
        raise InputError(
            f"surface: no measured cell of the garment lies {_rim(profile):.4f} m "
            "inside its rim; is the mask right, and the profile the sensor's?"
        )
    ny, nx = height.shape
    x = np.arange(nx, dtype=np.float64) * resolution
    y = np.arange(ny, dtype=np.float64) * resolution

    def fit(smoothing: float) -> TensorSpline:
        knots = profile.knot_spacing
        return fit_spline(height, weight, resolution, knots, smoothing=smoothing, patches=patches)

    spline = fit(profile.smoothing)
    z, zx, zy, zxx, zxy, zyy = spline.sample(x, y, [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
    fine = [z, zxx, zxy, zyy]
    if profile.fine_smoothing != profile.smoothing:
        fine = fit(profile.fine_smoothing).sample(x, y, [(0, 0), (2, 0), (1, 1), (0, 2)])
    reach = max(0.5 * profile.knot_spacing, _rim(profile)) / resolution
    inside = garment & _near_data(weight, reach)
    k_max, k_min = principal_curvatures(zx, zy, zxx, zxy, zyy)
    index = shape_index(k_max, k_min)
    classes = classify(index, curvedness(k_max, k_min), profile.flat_curvature)
    classes[~inside] = FLAT
    classes = majority_filter(classes, max(1, round(profile.rank_radius / resolution)))
    classes[~inside] = FLAT
    first = np.array([columns.start, rows.start], dtype=float) + 0.5 * (stride - 1)
    return Surface(
        z=z,
        zx=zx,
        zy=zy,
        zxx=zxx,
        zxy=zxy,
        zyy=zyy,
        garment=garment,
        inside=inside,
        k_max=k_max,
        k_min=k_min,
        shape_index=index,
        classes=classes,
        resolution=resolution,
        origin=range_map.origin + first * range_map.resolution,
        spline=spline,
        fine=(fine[0], fine[1], fine[2], fine[3]),
    )


def sample(image: Floats, points: NDArray[np.float64]) -> Floats:
    """Interpolate an image bilinearly at (..., 2) points (column, row); border values outside."""
    flat = np.ascontiguousarray(points, dtype=np.float32).reshape(-1, 2)
    if len(flat) == 0:
        return np.zeros(points.shape[:-1], dtype=np.float32)
    columns = 1024  # cv2.remap is limited to maps of fewer than 32768 rows
    rows = -(-len(flat) // columns)
    grid = np.zeros((rows * columns, 2), dtype=np.float32)
    grid[: len(flat)] = flat
    out = cv2.remap(
        image,
        grid.reshape(rows, columns, 2),
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(out.reshape(-1)[: len(flat)].reshape(points.shape[:-1]))


def spread(values: NDArray[_Scalar], surface: Surface, range_map: RangeMap) -> NDArray[_Scalar]:
    """Resample values from the surface's grid to the range map's (nearest; 0 elsewhere)."""
    stride = round(surface.resolution / range_map.resolution)
    first = (surface.origin - range_map.origin) / range_map.resolution - 0.5 * (stride - 1)
    column, row = np.rint(first).astype(int).tolist()
    fine = values.repeat(stride, axis=0).repeat(stride, axis=1) if stride > 1 else values
    out = np.zeros(range_map.shape, dtype=values.dtype)
    height, width = (
        min(fine.shape[0], out.shape[0] - row),
        min(fine.shape[1], out.shape[1] - column),
    )
    out[row : row + height, column : column + width] = fine[:height, :width]
    return out


def _window(range_map: RangeMap, profile: NoiseProfile) -> tuple[slice, slice, int]:
    """Return the garment's rows and columns, in whole blocks of `stride` cells, and the stride."""
    step = min(profile.knot_spacing / SAMPLES_PER_KNOT, COARSEST_SAMPLE)
    stride = max(1, int(step / range_map.resolution + 1e-6))
    margin = round(profile.knot_spacing / range_map.resolution)
    spans = []
    for axis in (1, 0):
        used = np.flatnonzero(range_map.garment.any(axis=axis))
        if len(used) == 0:
            raise InputError("surface: the range map has no garment; check the segmentation")
        size = range_map.shape[1 - axis]
        low = max(int(used[0]) - margin, 0)
        high = min(int(used[-1]) + 1 + margin, size)
        spans.append(slice(low, low + max((high - low) // stride, 1) * stride))
    if min(span.stop - span.start for span in spans) < 4 * stride:
        raise InputError("surface: the garment is only a few cells large; check the segmentation")
    return spans[0], spans[1], stride


def _binned(
    range_map: RangeMap, rows: slice, columns: slice, stride: int, profile: NoiseProfile
) -> tuple[Floats, Floats, Mask]:
    """Return weights, mean heights (holes filled) and mask of stride x stride blocks."""
    garment = range_map.garment[rows, columns].astype(np.uint8)
    size = (garment.shape[1] // stride, garment.shape[0] // stride)
    valid = range_map.valid[rows, columns].astype(np.float32)
    height = range_map.height[rows, columns]
    if stride > 1:
        height = cv2.resize(height * valid, size, interpolation=cv2.INTER_AREA)
        valid = cv2.resize(valid, size, interpolation=cv2.INTER_AREA)
        height = height / np.maximum(valid, 1e-6)
        garment = cv2.resize(garment, size, interpolation=cv2.INTER_NEAREST_EXACT)
    rim = _rim(profile) / (range_map.resolution * stride)
    inner = _depth_inside(garment) > rim
    weight = np.where(inner, valid, np.float32(0.0))
    height, weight = fill_holes(height, weight, inner, range_map.resolution * stride)
    return weight, height, garment.astype(bool)


def _rim(profile: NoiseProfile) -> float:
    return max(RIM_SPANS * profile.knot_spacing, RIM_LEAST)


def _depth_inside(mask: NDArray[np.uint8]) -> Floats:
    """Return the distance to the mask's rim, cells; the image border is not a rim."""
    return np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, 3), dtype=np.float32)


def _near_data(weight: Floats, reach: float) -> Mask:
    missing = (weight <= 0.0).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(missing, cv2.DIST_L2, 3) <= max(reach, 1.0))
