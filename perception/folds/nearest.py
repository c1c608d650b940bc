"""Nearest points."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def nearest(
    tree: cKDTree, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the distances (n,) of points (n, 2) to the nearest of a tree, and its index (n,)."""
    distance, index = tree.query(points)
    return np.asarray(distance, dtype=float), np.asarray(index, dtype=np.intp)
