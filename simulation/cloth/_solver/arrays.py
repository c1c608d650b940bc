"""Constant arrays of the cloth solver: masses, compliances, triangles."""

import dataclasses as dc

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.cloth import ClothMaterial
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.layout import ROW, STRIDE, empty_rows, put
from unwrinkle.simulation.cloth.outlines import Outline


@dc.dataclass(frozen=True, eq=False)
class ClothArrays:
    """Constant inputs of the kernels; see `layout` and `step`.

    Attributes:
        rows: (nx + 2, channels, STRIDE) constants of the nodes, see `layout`.
        turned: the transposed array (i and j exchanged), for the yarns along j.
        yarn_j: (nx + 2, STRIDE) compliances / dt^2 of the springs to (i, j + 1).
        inverse_mass: (S,), 1/kg.
        numbers: (n,) grid numbers of the nodes that are cloth.
        places: (n,) their indices in `rows`.
        triangles: (m, 3) corners as indices into these nodes.
        triangle_places: (m, 3) corners as indices in `rows`.
        rest: (n, 2) these nodes in the flat cloth, m.
        centres: (m, 2) centroids of the triangles in the flat cloth, m.
    """

    rows: NDArray[np.float64]
    turned: NDArray[np.float64]
    yarn_j: NDArray[np.float64]
    inverse_mass: NDArray[np.float64]
    numbers: NDArray[np.intp]
    places: NDArray[np.uint64]
    triangles: NDArray[np.intp]
    triangle_places: NDArray[np.uint64]
    rest: NDArray[np.float64]
    centres: NDArray[np.float64]


def places_of(numbers: NDArray[np.intp], columns: int) -> NDArray[np.uint64]:
    """Return the indices in the layout of nodes of a grid with `columns` columns."""
    return ((numbers // columns + 1) * ROW + numbers % columns).astype(np.uint64)


def cloth_arrays(
    outline: Outline, material: ClothMaterial, step: float, clamped: NDArray[np.intp]
) -> ClothArrays:
    """Compute the arrays of a garment.

    Raises:
        InputError: the bending is too stiff for this time step and spacing.
    """
    mask, cells, h = outline.mask, outline.cells, outline.spacing
    nx, ny = mask.shape
    quarter = np.pad(cells, 1).astype(float) / 4.0
    share = quarter[:-1, :-1] + quarter[1:, :-1] + quarter[:-1, 1:] + quarter[1:, 1:]
    inverse_mass = np.zeros((nx, ny))
    inverse_mass[mask] = 1.0 / (material.areal_density * h * h * share[mask])
    free = inverse_mass.copy()
    free.reshape(-1)[clamped] = 0.0
    # A spring has the stiffness of the cells on both sides, half of it at the border.
    padded = np.pad(cells, ((0, 0), (1, 1))).astype(float)
    along_i = np.zeros((nx, ny))
    along_i[:-1] = 0.5 * (padded[:, :-1] + padded[:, 1:])
    padded = np.pad(cells, ((1, 1), (0, 0))).astype(float)
    along_j = np.zeros((nx, ny))
    along_j[:, :-1] = 0.5 * (padded[:-1] + padded[1:])
    rising, falling = np.zeros((nx, ny)), np.zeros((nx, ny))
    rising[:-1, :-1] = cells
    falling[:-1, 1:] = cells
    bend_i, bend_j = np.zeros((nx, ny)), np.zeros((nx, ny))
    bend_i[1:-1] = np.minimum(along_i[:-2], along_i[1:-1])
    bend_j[:, 1:-1] = np.minimum(along_j[:, :-2], along_j[:, 1:-1])
    bend_rising, bend_falling = np.zeros((nx, ny)), np.zeros((nx, ny))
    bend_rising[1:-1, 1:-1] = cells[:-1, :-1] & cells[1:, 1:]
    bend_falling[1:-1, 1:-1] = cells[:-1, 1:] & cells[1:, :-1]
    # Bending along four lines with 2/3 of the stiffness equals an isotropic plate of Poisson's
    # ratio 1/3.
    straight = 2.0 / 3.0 * material.first_bending / h**2
    rows, turned = empty_rows(nx), empty_rows(ny)
    put(rows, "yarn", _compliance(along_i, material.stretch, step))
    springs_j = _compliance(along_j, material.stretch, step)
    put(turned, "yarn", springs_j.T)
    yarn_j = np.full((nx + 2, STRIDE), np.inf)
    yarn_j[1:-1, :ny] = springs_j
    put(rows, "rising", _compliance(rising, material.shear, step))
    put(rows, "falling", _compliance(falling, material.shear, step))
    weight = 1.0 / (material.areal_density * h * h * np.maximum(share, 0.25))
    for target, channel, stiffness, parts in (
        (rows, "bend", straight, bend_i),
        (turned, "bend", straight, bend_j),
        (rows, "bend_rising", 0.25 * straight, bend_rising),
        (rows, "bend_falling", 0.25 * straight, bend_falling),
    ):
        values = _compensated(_compliance(parts, stiffness, step), weight, step)
        put(target, channel, values.T if target is turned else values)
    put(rows, "next_i", (along_i > 0.0).astype(float))
    put(rows, "next_j", (along_j > 0.0).astype(float))
    numbers = np.flatnonzero(mask)
    among = np.full(nx * ny, -1)
    among[numbers] = np.arange(len(numbers))
    corners = _triangles(cells, ny)
    plane = outline.plane.reshape(-1, 2)
    triangles, rest = among[corners], plane[numbers]
    for value in (numbers, triangles, rest):  # returned to callers
        value.flags.writeable = False
    return ClothArrays(
        rows=rows,
        turned=turned,
        yarn_j=yarn_j,
        inverse_mass=free.ravel(),
        numbers=numbers,
        places=places_of(numbers, ny),
        triangles=triangles,
        triangle_places=places_of(corners, ny),
        rest=rest,
        centres=plane[corners].mean(axis=1),
    )


def _compliance(shares: NDArray[np.float64], stiffness: float, step: float) -> NDArray[np.float64]:
    """Return the compliance / dt^2 of elements with a share of a stiffness, N/m; infinite for 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / (shares * stiffness * step**2))


def _compensated(
    compliance: NDArray[np.float64], weight: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Subtract the compliance that the sequential projection of the bending elements adds.

    A bending element (1, -2, 1) is disturbed by the two that follow on its line. If all elements of
    a line have the same impulse, the remaining second difference is (compliance + (6 - 4 + 1) w)
    times the impulse, that is, three inverse masses w too compliant.
    """
    present = np.isfinite(compliance)
    compensated = compliance - 3.0 * weight
    if (compensated[present] <= 0.0).any():
        # The compliance is proportional to 1 / step^2, the weight is independent of it.
        ratio = float((compliance[present] / (3.0 * weight[present])).min())
        raise InputError(
            f"cloth: bending is too stiff for a time step of {step:g} s at this spacing; "
            f"give {0.95 * step * np.sqrt(ratio):.2g} s or less, or fewer nodes"
        )
    return np.where(present, compensated, np.inf)


def _triangles(cells: NDArray[np.bool_], columns: int) -> NDArray[np.intp]:
    """Return two triangles per cell (m, 3), alternating diagonals, counter-clockwise from +z."""
    i, j = np.nonzero(cells)
    a = i * columns + j
    b, c, d = a + columns, a + columns + 1, a + 1
    even = ((i + j) % 2 == 0)[:, None]
    first = np.where(even, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(even, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.stack([first, second], axis=1).reshape(-1, 3)
