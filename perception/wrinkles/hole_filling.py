"""Bridges over what is hidden behind a fold: a crest seen from one side only is still a crest."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

#: Holes with room for a larger disc than this are left open, metres: nobody knows what lies there.
WIDEST = 0.022
#: Weight of a bridged cell, where a measured one has 1.
WEIGHT = 0.2

_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))


def fill_holes(
    height: NDArray[np.float32],
    weight: NDArray[np.float32],
    wanted: NDArray[np.bool_],
    resolution: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Fill holes with the membrane that is spanned by what was measured around them.

    A head that looks down at a slant does not see the far flank of a steep fold. The membrane goes from the crest
    straight down to where the cloth is seen again, much as cloth that lies over itself does.

    Args:
        height: (ny, nx) metres.
        weight: (ny, nx) of each cell, 0 where nothing was measured.
        wanted: (ny, nx) where a surface is wanted.
        resolution: side of a cell, metres.

    Returns:
        Heights and weights with the holes filled, of which a disc of radius `WIDEST` covers the deepest point.
    """
    hole = wanted & (weight <= 0.0)
    if not hole.any():
        return height, weight
    count, labels = cv2.connectedComponents(hole.astype(np.uint8), connectivity=4)
    depth = np.asarray(cv2.distanceTransform(hole.astype(np.uint8), cv2.DIST_L2, 3))
    deepest = np.zeros(count, dtype=np.float32)
    np.maximum.at(deepest, labels.ravel(), depth.ravel())
    narrow = deepest * resolution <= WIDEST
    narrow[0] = False
    # A hole that touches nothing measured has nothing to hang on.
    anchored = np.zeros(count, dtype=bool)
    around = binary_dilation(weight > 0.0)
    anchored[np.unique(labels[around & hole])] = True
    chosen = (narrow & anchored)[labels] & hole
    if not chosen.any():
        return height, weight
    height, weight = height.copy(), weight.copy()
    height[chosen] = _membrane(height, weight > 0.0, chosen)
    weight[chosen] = WEIGHT
    return height, weight


def _membrane(
    height: NDArray[np.float32], known: NDArray[np.bool_], chosen: NDArray[np.bool_]
) -> NDArray[Any]:
    """Heights of the chosen cells that satisfy Laplace's equation; edges without data are free."""
    ny, nx = height.shape
    row, column = np.nonzero(chosen)
    number = np.full(height.shape, -1, dtype=np.intp)
    number[row, column] = np.arange(len(row))
    diagonal = np.zeros(len(row))
    right = np.zeros(len(row))
    rows, columns = [], []
    for down, across in _NEIGHBOURS:
        r, c = row + down, column + across
        inside = (r >= 0) & (r < ny) & (c >= 0) & (c < nx)
        r, c = np.clip(r, 0, ny - 1), np.clip(c, 0, nx - 1)
        measured, unknown = inside & known[r, c], inside & (number[r, c] >= 0)
        diagonal += measured | unknown
        right += np.where(measured, height[r, c], 0.0)
        rows.append(np.flatnonzero(unknown))
        columns.append(number[r, c][unknown])
    i, j = np.concatenate(rows), np.concatenate(columns)
    size = len(row)
    matrix = coo_array(
        (
            np.concatenate([diagonal, np.full(len(i), -1.0)]),
            (np.concatenate([np.arange(size), i]), np.concatenate([np.arange(size), j])),
        ),
        shape=(size, size),
    )
    return np.asarray(spsolve(matrix.tocsc(), right))
