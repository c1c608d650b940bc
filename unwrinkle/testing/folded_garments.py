"""Range maps of garments with a part folded over, by geometry alone."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile

#: Standard deviation of the noise of a map's cells, m: what is left after averaging.
_NOISE = {"stereo": 1e-4, "stereo-head": 2e-4, "xtion": 8e-4, "tof": 8e-4}
#: Finest resolution of the maps, m: half that of the grid on which folds are sought.
_FINEST = 0.001
_CENTRE = np.array([0.0, -1.10])
_TABLE = 0.70


def folded_map(
    corners: Sequence[Sequence[float]] | NDArray[np.float64],
    line: tuple[float, float] | None = None,
    *,
    yaw: float = 0.0,
    thickness: float = 0.0025,
    bulge: float = 0.0,
    sensor: str = "stereo",
    seed: int = 0,
) -> RangeMap:
    """Return the range map of a flat garment of which the part beyond a line lies folded over.

    Args:
        corners: (n, 2) of the garment, m, about its centre.
        line: angle of the normal, rad, and offset, m, of the fold line in the garment's plane; None
            for a flat garment.
        yaw: turn of the garment on the table, rad.
        thickness: of a layer, m.
        bulge: height of the fold's rim over two layers, m; it fades within 20 mm.
        sensor: name of the noise profile.
        seed: of the noise.
    """
    resolution = max(noise_profile(sensor).resolution, _FINEST)
    polygon = np.asarray(corners, dtype=float)
    half = float(np.hypot(*polygon.T).max()) + 0.06
    count = 2 * round(half / resolution) + 1
    axis = (np.arange(count) - count // 2) * resolution
    x, y = np.meshgrid(axis, axis)
    c, s = np.cos(yaw), np.sin(yaw)
    u, v = c * x + s * y, -s * x + c * y
    below = _inside(polygon, u, v, resolution)
    layers = below.astype(int)
    height = np.where(below, thickness, 0.0)
    if line is not None:
        normal = np.array([np.cos(line[0]), np.sin(line[0])])
        beyond = u * normal[0] + v * normal[1] - line[1]
        layers[beyond > 0.0] = 0
        # What lies at a distance d within the line is the mirror image of what was at d beyond it.
        mirrored = _inside(
            polygon, u - 2.0 * beyond * normal[0], v - 2.0 * beyond * normal[1], resolution
        )
        over = mirrored & (beyond <= 0.0)
        layers += over
        fade = np.clip(1.0 + beyond / 0.020, 0.0, 1.0)
        height = thickness * layers + np.where(over, bulge * fade, 0.0)
    garment = layers > 0
    height += np.random.default_rng(seed).normal(0.0, _NOISE[sensor], height.shape)
    return RangeMap(
        height=height.astype(np.float32),
        valid=np.ones(height.shape, dtype=bool),
        garment=garment,
        resolution=resolution,
        origin=_CENTRE - (count // 2) * resolution,
        table_height=_TABLE,
        sensor=sensor,
        mask_by="colour",
    )


def _inside(
    polygon: NDArray[np.float64],
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    resolution: float,
) -> NDArray[np.bool_]:
    """Return which points lie in a polygon, by a mask of it with cells of half the resolution."""
    cell = 0.5 * resolution
    low = np.minimum(polygon.min(axis=0), [u.min(), v.min()]) - 4 * cell
    size = np.ceil(
        (np.maximum(polygon.max(axis=0), [u.max(), v.max()]) + 4 * cell - low) / cell
    ).astype(int)
    mask = np.zeros((size[1], size[0]), dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint((polygon - low) / cell).astype(np.int32)], 1)
    columns = np.rint((u - low[0]) / cell).astype(int).clip(0, size[0] - 1)
    rows = np.rint((v - low[1]) / cell).astype(int).clip(0, size[1] - 1)
    return np.asarray(mask[rows, columns] > 0)
