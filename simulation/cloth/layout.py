"""Memory layout of the cloth solver: one array of rows with one channel per quantity.

Row r of the array holds the nodes (i = r - 1, j = 0..); channel c begins at column c * STRIDE. The
offset of a neighbour in any direction is a compile-time constant, so that every loop over j
vectorises without a check for aliasing. The first and last row and the end of each channel are
zero: a missing neighbour has no mass and no stiffness.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Length of a channel in a row.
STRIDE = 136

#: Limit of the nodes along a side; at least two zeros remain at either end of a channel.
MOST_NODES = STRIDE - 4
_NAMES = (
    "x y z",  # position
    "px py pz",  # position at the beginning of the substep
    "vx vy vz",  # velocity
    "w",  # inverse of the effective mass; 0 where held or where there is no cloth
    "w0",  # inverse mass, likewise
    "nx ny nz",  # unit normal, or 0
    "yarn",  # compliance / dt^2 of the spring to (i + 1, j); infinite where there is none
    "rising falling",  # the same to (i + 1, j + 1) and (i + 1, j - 1)
    "bend bend_rising bend_falling",  # compliance / dt^2 of bending about (i, j) along those lines
    "rest rest_rising rest_falling",  # plastic rest of those bendings, second difference in m
    "next_i next_j",  # 1 where (i + 1, j), (i, j + 1) is joined by cloth
    "ux uy uz cp dp",  # scratch of the tridiagonal solver
    "sx sy sz",  # scratch of the viscosity
)
CHANNELS: Mapping[str, int] = {name: number for number, name in enumerate(" ".join(_NAMES).split())}
ROW = STRIDE * len(CHANNELS)


def offset(name: str) -> np.uint64:
    """Return the offset of a channel in its row; unsigned, which avoids sign tests of indices."""
    return np.uint64(STRIDE * CHANNELS[name])


def empty_rows(rows: int) -> NDArray[np.float64]:
    """Allocate zeros for rows of nodes and two guard rows, (rows + 2, channels, STRIDE)."""
    return np.zeros((rows + 2, len(CHANNELS), STRIDE))


def put(rows: NDArray[np.float64], name: str, values: NDArray[Any]) -> None:
    """Write values (nodes i, nodes j) into a channel."""
    rows[1:-1, CHANNELS[name], : values.shape[1]] = values


def get(rows: NDArray[np.float64], name: str, columns: int) -> NDArray[np.float64]:
    """Return a copy of a channel, (nodes i, columns)."""
    return rows[1:-1, CHANNELS[name], :columns].copy()
