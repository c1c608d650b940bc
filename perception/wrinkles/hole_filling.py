"""Hole filling of height maps: a membrane over cells that a fold hides from the camera."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

#: Radius of the largest inscribed disc up to which a hole is filled, metres.
WIDEST = 0.022
#: Weight of a filled cell, relative to 1 for a measured one.
WEIGHT = 0.2

_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))


def fill_holes(
    height: NDArray[np.float32],
    weight: NDArray[np.float32],
    wanted: NDArray[np.bool_],
    resolution: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Fill small holes with a membrane (Laplace's equation) through the measured cells around them.

    A camera that looks down at a slant does not see the far side of a steep fold. The membrane
    descends from the crest to where the cloth is seen again, as cloth lying on itself does.

    Args:
        height: (ny, nx) metres.
        weight: (ny, nx) weight of each cell, 0 where nothing was measured.
        wanted: (ny, nx) bool, cells in which holes are filled.
        resolution: side of a cell, metres.

    Returns:
        Heights and weights with the holes filled whose largest inscribed disc has a radius of at
        most `WIDEST`.
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
    # A hole without a measured neighbour has no boundary condition.
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
    """Solve Laplace's equation on the chosen cells; edges without data are free (Neumann)."""
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
