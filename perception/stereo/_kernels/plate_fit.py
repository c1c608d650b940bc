"""Weighted thin-plate fit of a disparity surface with discontinuities.

Minimises sum_i a_i (d_i - t_i)^2 + stiffness * sum_k w_k c_k^2 over the cells of a grid. c_k are
the second differences along rows, along columns and mixed (thin plate, Terzopoulos 1983), in pixels
per cell squared. The robust weight w_k = 1 / (1 + (c_k / crease)^2)^2 (Geman and McClure 1987) is
computed per direction from the current surface, so that at the crest of a steep wrinkle or a fold
the surface is smoothed along the crest but not across it.
"""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid
from unwrinkle.models.compiled import njit
from unwrinkle.perception._parallel import parallel_rows

#: Lower bound of the matrix's diagonal.
_MIN_DIAGONAL = 1e-6


class Plate:
    """Solver for surfaces of one shape (h, w); its buffers are reused between fits."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Allocate the buffers."""
        h, w = shape
        self._hold = np.empty((3, h, w), dtype=np.float32)
        self._fields = np.empty((5, h, w), dtype=np.float32)
        self._parts = np.zeros((2, h))

    def fit(
        self,
        surface: Grid,
        weight: Grid,
        pull: Grid,
        *,
        stiffness: float,
        crease: float,
        iterations: int,
    ) -> Grid:
        """Compute the change (h, w) float32 of the surface that lowers the energy.

        Conjugate gradients with a diagonal preconditioner. Few iterations suffice, because long
        wavelengths have converged on a coarser image; stopping early keeps the result close to
        `surface`. The result is a buffer that the next call overwrites.

        Args:
            surface: (h, w) float32 current d.
            weight: (h, w) float32 a >= 0; 0 where nothing was measured.
            pull: (h, w) float32 a (t - d), the negative half gradient of the data term.
            stiffness: of the plate.
            crease: scale of the robust weight, pixels per cell squared.
            iterations: limit of the solver's iterations.
        """
        h, hold, parts = surface.shape[0], self._hold, self._parts
        change, along, residual, inverse, product = self._fields
        change[:] = 0.0
        parallel_rows(_holds, h, surface, np.float32(crease**2), np.float32(stiffness), hold)
        parallel_rows(_apply, h, surface, change, hold, product, parts)
        parallel_rows(_start, h, weight, pull, hold, product, residual, inverse, along, parts)
        downhill = float(parts[1].sum())
        for _ in range(iterations):
            parallel_rows(_apply, h, along, weight, hold, product, parts)
            uphill = float(parts[0].sum())
            if not uphill > 0.0 or not downhill > 0.0:
                break
            step = np.float32(downhill / uphill)
            parallel_rows(_descend, h, step, along, product, inverse, change, residual, parts)
            last, downhill = downhill, float(parts[1].sum())
            parallel_rows(_turn, h, np.float32(downhill / last), residual, inverse, along)
        return np.asarray(change)


# Loops run over views of rows, which the compiler vectorises.


@njit(nogil=True, fastmath=True)
def _second(before: Grid, here: Grid, after: Grid, hold: Grid, moment: Grid) -> None:
    """Compute the weighted second difference of three rows, or of three shifted views of one."""
    two = np.float32(2.0)
    for x in range(moment.size):
        moment[x] = hold[x] * (before[x] - two * here[x] + after[x])


@njit(nogil=True, fastmath=True)
def _twist(here: Grid, right: Grid, below: Grid, across: Grid, hold: Grid, moment: Grid) -> None:
    """Compute the weighted mixed difference of cells with their right and lower neighbours."""
    for x in range(moment.size):
        moment[x] = hold[x] * (here[x] - right[x] - below[x] + across[x])


@njit(nogil=True, fastmath=True)
def _let_go(hold: Grid, square: np.float32, most: np.float32) -> None:
    """Replace second differences by their robust weights times the stiffness `most`."""
    for x in range(hold.size):
        share = square / (square + hold[x] * hold[x])
        hold[x] = most * share * share


@njit(nogil=True, fastmath=True)
def _holds(
    first: int, last: int, d: Grid, square: np.float32, stiffness: np.float32, hold: Grid
) -> None:
    """Compute the weights of the second differences: along rows, along columns, mixed."""
    h, w = d.shape
    one = np.ones(w, np.float32)
    for y in range(first, last):
        row = d[y]
        hold[:, y] = np.float32(0.0)
        inner = hold[0, y, 1 : w - 1]
        _second(row[: w - 2], row[1 : w - 1], row[2:], one[: w - 2], inner)
        _let_go(inner, square, stiffness)
        if 0 < y < h - 1:
            _second(d[y - 1], row, d[y + 1], one, hold[1, y])
            _let_go(hold[1, y], square, stiffness)
        if y < h - 1:
            below, inner = d[y + 1], hold[2, y, : w - 1]
            _twist(row[: w - 1], row[1:], below[: w - 1], below[1:], one[: w - 1], inner)
            _let_go(inner, square, np.float32(2.0) * stiffness)


@njit(nogil=True, fastmath=True)
def _columns_of(y: int, d: Grid, hold: Grid, moment: Grid) -> None:
    """Compute the weighted second difference along columns at row y; 0 at the border."""
    if 0 < y < d.shape[0] - 1:
        _second(d[y - 1], d[y], d[y + 1], hold[1, y], moment)
    else:
        moment[:] = np.float32(0.0)


@njit(nogil=True, fastmath=True)
def _across_of(y: int, d: Grid, hold: Grid, moment: Grid) -> None:
    """Compute the weighted mixed difference of rows y and y + 1 into moment[x + 1]; 0 outside."""
    h, w = d.shape
    moment[:] = np.float32(0.0)
    if 0 <= y < h - 1:
        here, below = d[y], d[y + 1]
        inner = moment[1:w]
        _twist(here[: w - 1], here[1:], below[: w - 1], below[1:], hold[2, y, : w - 1], inner)


@njit(nogil=True, fastmath=True)
def _gather(rows: Grid, above: Grid, here: Grid, below: Grid, product: Grid) -> None:
    """Sum the second differences of the moments along rows (padded by one) and along columns."""
    two = np.float32(2.0)
    n = product.size
    left, middle, right = rows[:n], rows[1 : n + 1], rows[2:]
    for x in range(n):
        along = left[x] - two * middle[x] + right[x]
        product[x] = along + above[x] - two * here[x] + below[x]


@njit(nogil=True, fastmath=True)
def _finish(before: Grid, after: Grid, weight: Grid, d: Grid, product: Grid) -> np.float32:
    """Add the mixed terms and the data term; return the scalar product with d."""
    n = product.size
    b0, b1, a0, a1 = before[:n], before[1:], after[:n], after[1:]
    total = np.float32(0.0)
    for x in range(n):
        value = product[x] + a1[x] - a0[x] - b1[x] + b0[x] + weight[x] * d[x]
        product[x] = value
        total += value * d[x]
    return total


@njit(nogil=True, fastmath=True)
def _apply(
    first: int,
    last: int,
    d: Grid,
    weight: Grid,
    hold: Grid,
    product: Grid,
    parts: NDArray[np.float64],
) -> None:
    """Compute the matrix product with d, and its scalar product with d per row in parts[0]."""
    w = d.shape[1]
    rows = np.zeros(w + 2, np.float32)
    above, here, below = np.zeros(w, np.float32), np.zeros(w, np.float32), np.zeros(w, np.float32)
    before, after = np.zeros(w + 1, np.float32), np.zeros(w + 1, np.float32)
    _columns_of(first - 1, d, hold, above)
    _columns_of(first, d, hold, here)
    _across_of(first - 1, d, hold, before)
    for y in range(first, last):
        _columns_of(y + 1, d, hold, below)
        _across_of(y, d, hold, after)
        row = d[y]
        _second(row[: w - 2], row[1 : w - 1], row[2:], hold[0, y, 1 : w - 1], rows[2:w])
        _gather(rows, above, here, below, product[y])
        parts[0, y] = _finish(before, after, weight[y], row, product[y])
        above, here, below = here, below, above
        before, after = after, before


@njit(nogil=True, fastmath=True)
def _add(to: Grid, values: Grid, times: np.float32) -> None:
    for x in range(to.size):
        to[x] += times * values[x]


@njit(nogil=True, fastmath=True)
def _diagonal(y: int, weight: Grid, hold: Grid, diagonal: Grid) -> None:
    """Compute row y of the matrix's diagonal."""
    h, w = weight.shape
    one, four = np.float32(1.0), np.float32(4.0)
    diagonal[:] = weight[y]
    _add(diagonal, hold[0, y], four)
    _add(diagonal, hold[1, y], four)
    _add(diagonal[1:], hold[0, y, : w - 1], one)
    _add(diagonal[: w - 1], hold[0, y, 1:], one)
    _add(diagonal, hold[2, y], one)
    _add(diagonal[1:], hold[2, y, : w - 1], one)
    if y > 0:
        _add(diagonal, hold[1, y - 1], one)
        _add(diagonal, hold[2, y - 1], one)
        _add(diagonal[1:], hold[2, y - 1, : w - 1], one)
    if y < h - 1:
        _add(diagonal, hold[1, y + 1], one)


@njit(nogil=True, fastmath=True)
def _start_row(
    diagonal: Grid, pull: Grid, product: Grid, residual: Grid, inverse: Grid, along: Grid
) -> np.float32:
    one, least, total = np.float32(1.0), np.float32(_MIN_DIAGONAL), np.float32(0.0)
    for x in range(diagonal.size):
        share = one / max(diagonal[x], least)
        left = pull[x] - product[x]
        inverse[x] = share
        residual[x] = left
        along[x] = share * left
        total += share * left * left
    return total


@njit(nogil=True, fastmath=True)
def _start(
    first: int,
    last: int,
    weight: Grid,
    pull: Grid,
    hold: Grid,
    product: Grid,
    residual: Grid,
    inverse: Grid,
    along: Grid,
    parts: NDArray[np.float64],
) -> None:
    """Initialise the residual, the inverse diagonal and the search direction."""
    diagonal = np.empty(weight.shape[1], np.float32)
    for y in range(first, last):
        _diagonal(y, weight, hold, diagonal)
        parts[1, y] = _start_row(diagonal, pull[y], product[y], residual[y], inverse[y], along[y])


@njit(nogil=True, fastmath=True)
def _descend_row(step: np.float32, product: Grid, inverse: Grid, residual: Grid) -> np.float32:
    total = np.float32(0.0)
    for x in range(residual.size):
        left = residual[x] - step * product[x]
        residual[x] = left
        total += inverse[x] * left * left
    return total


@njit(nogil=True, fastmath=True)
def _descend(
    first: int,
    last: int,
    step: np.float32,
    along: Grid,
    product: Grid,
    inverse: Grid,
    change: Grid,
    residual: Grid,
    parts: NDArray[np.float64],
) -> None:
    """Take a step; store the preconditioned squared residual per row in parts[1]."""
    for y in range(first, last):
        _add(change[y], along[y], step)
        parts[1, y] = _descend_row(step, product[y], inverse[y], residual[y])


@njit(nogil=True, fastmath=True)
def _turn_row(share: np.float32, residual: Grid, inverse: Grid, along: Grid) -> None:
    for x in range(along.size):
        along[x] = inverse[x] * residual[x] + share * along[x]


@njit(nogil=True, fastmath=True)
def _turn(
    first: int, last: int, share: np.float32, residual: Grid, inverse: Grid, along: Grid
) -> None:
    """Update the search direction."""
    for y in range(first, last):
        _turn_row(share, residual[y], inverse[y], along[y])
