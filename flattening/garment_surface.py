"""The garment as it was seen, as a coloured mesh of at most about 100 x 100 vertices, for plans and
previews.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.perception.wrinkles.targeting import garment_contour
from unwrinkle.planning.plan import GarmentSurface

#: Most vertices along either axis of the mesh.
MOST_VERTICES = 100

#: Share of a block's cells that must belong to the garment for the block to become a vertex.
_LEAST_COVER = 0.5

#: Lines are drawn this far above the surface, m.
_LIFT = 0.001


def garment_of(analysis: Analysis, index: int | None) -> GarmentSurface:
    """Return the garment of an analysis, with one of its wrinkles and the contour around it.

    Args:
        analysis: of a range map.
        index: of the wrinkle, largest first; None for no wrinkle.

    Raises:
        InputError: no garment was seen.
    """
    wrinkle = None if index is None else analysis.wrinkles[index]
    contour = garment_contour(analysis.surface, None if wrinkle is None else wrinkle.centre)
    return garment_surface(
        analysis.range_map,
        None if wrinkle is None else wrinkle.curve,
        None if contour is None else contour.points,
    )


def garment_surface(
    range_map: RangeMap,
    ridge: NDArray[np.floating[Any]] | None = None,
    outline: NDArray[np.floating[Any]] | None = None,
) -> GarmentSurface:
    """Average the garment's cells in square blocks, one vertex each; heights are true.

    Args:
        range_map: height above the table and the garment's mask.
        ridge: (R, 3) ridge line of the wrinkle, world, m; none is drawn if left out.
        outline: (C, 2) closed contour of the garment, world, m; found in the mask if left out.

    Returns:
        At most about 100 x 100 vertices in the world frame. Colours are the range map's, or a
        colour map of the height. Parts of the garment that were not measured are holes.

    Raises:
        InputError: no garment, or nothing measured on it.
    """
    rows, columns = np.nonzero(range_map.garment)
    if len(rows) == 0 or not np.any(range_map.garment & range_map.valid):
        raise InputError("range map: no measured cell belongs to the garment; nothing to show")
    top, left = int(rows.min()), int(columns.min())
    ny, nx = int(rows.max()) + 1 - top, int(columns.max()) + 1 - left
    block = max(1, math.ceil(max(ny, nx) / MOST_VERTICES))
    window = (slice(top, top + ny), slice(left, left + nx))
    garment = range_map.garment[window]
    seen = garment & range_map.valid[window]
    weight = _block_sums(seen.astype(float), block)
    safe = np.maximum(weight, 1.0)
    height = _block_sums(np.where(seen, range_map.height[window], 0.0), block) / safe
    covered = _block_sums(garment.astype(float), block) >= _LEAST_COVER * block * block
    used = covered & (weight > 0.0)
    triangles = _triangles(used)
    if len(triangles) == 0:
        raise InputError("range map: the garment is too small or too full of holes to show")
    number = np.full(used.shape, -1, dtype=np.int32)
    number[used] = np.arange(np.count_nonzero(used))
    i, j = np.nonzero(used)
    half = 0.5 * (block - 1)
    x, y = range_map.world_from_cell(
        np.column_stack([left + block * j + half, top + block * i + half])
    ).T
    z = range_map.table_height + height[used]
    return GarmentSurface(
        p_WV=np.column_stack([x, y, z]).astype(np.float32),
        triangles=number.ravel()[triangles].astype(np.int32),
        colours=_colours(range_map, window, garment, block, used, height),
        ridge=_lifted(np.zeros((0, 3)) if ridge is None else np.asarray(ridge, dtype=float)),
        outline=_outline(range_map, outline),
    )


def _block_sums(values: NDArray[Any], block: int) -> NDArray[np.float64]:
    """Sums over blocks of block x block cells; what lies outside the array counts as zero."""
    ny, nx = values.shape
    padded = np.pad(values, ((0, -ny % block), (0, -nx % block)))
    by, bx = padded.shape[0] // block, padded.shape[1] // block
    return np.asarray(padded.reshape(by, block, bx, block).sum(axis=(1, 3)), dtype=float)


def _triangles(used: Mask) -> NDArray[np.intp]:
    """Triangles (F, 3) of indices into the raveled grid, anticlockwise seen from above."""
    index = np.arange(used.size).reshape(used.shape)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    d, c = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return faces[used.ravel()[faces].all(axis=1)]


def _colours(
    range_map: RangeMap,
    window: tuple[slice, slice],
    garment: Mask,
    block: int,
    used: Mask,
    height: NDArray[np.float64],
) -> NDArray[np.uint8]:
    if range_map.colour is None:
        low, high = np.percentile(height[used], (2.0, 98.0))
        level = np.clip((height[used] - low) / max(high - low, 1e-3), 0.0, 1.0)
        table = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_CIVIDIS)
        return np.asarray(table[np.round(255 * level).astype(int), 0, ::-1], dtype=np.uint8)
    cover = np.maximum(_block_sums(garment.astype(float), block), 1.0)
    colour = np.where(garment[..., None], range_map.colour[window], 0).astype(float)
    means = [_block_sums(colour[..., k], block)[used] / cover[used] for k in range(3)]
    return np.round(np.column_stack(means)).astype(np.uint8)


def _outline(range_map: RangeMap, outline: NDArray[np.floating[Any]] | None) -> NDArray[np.float32]:
    if outline is None:
        borders, _ = cv2.findContours(
            range_map.garment.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cells = max(borders, key=cv2.contourArea)[:, 0, :].astype(float)
        outline = range_map.world_from_cell(cells[:: max(1, len(cells) // 400)])
    points = np.asarray(outline, dtype=float)[:, :2]
    closed = np.vstack([points, points[:1]])
    return _lifted(np.column_stack([closed, np.full(len(closed), range_map.table_height)]))


def _lifted(points: NDArray[np.float64]) -> NDArray[np.float32]:
    return (points + [0.0, 0.0, _LIFT]).astype(np.float32)
