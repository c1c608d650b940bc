"""Normal equations of dense matching along rows, summed over square cells.

At every pixel the right image is sampled at the current disparity, and products of the difference e
and the mean gradient g of both images are summed over the cell (Lucas and Kanade 1981, in one
dimension; symmetric as in Birchfield and Tomasi 1998). Both images are filtered by a cubic
B-spline: its derivative is exact, its blur is the same in both images, and interpolation between
pixels causes no sub-pixel bias. The kernel passes over the images once, without full-size
temporaries.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Grid, Image
from unwrinkle.models.compiled import njit
from unwrinkle.perception._parallel import parallel_rows


@dataclass(frozen=True, eq=False)
class CellSums:
    """Sums over the pixels of each cell seen in both images; all (rows, columns) float32.

    Attributes:
        gg: sum of g^2, g the gradient along the row, grey levels per pixel.
        ge: sum of g e, e = left - right, grey levels.
        g, e: sums of g and of e.
        ee: sum of e^2.
        n: number of pixels.
        s, ss: sums of s = (left + right) / 2 - 128, grey levels, and of s^2.
        dd: sum of the squared difference of the left and the right gradient.
    """

    gg: Grid
    ge: Grid
    g: Grid
    e: Grid
    ee: Grid
    n: Grid
    s: Grid
    ss: Grid
    dd: Grid


def cell_sums(
    left: Image,
    right: Image,
    disparity: Grid,
    cell: int,
    scale: float,
    out: NDArray[np.float32] | None = None,
) -> CellSums:
    """Compute the sums over cells of `cell` x `cell` pixels at a disparity.

    Args:
        left, right: (rows * cell, columns * cell) uint8; 0 marks unseen pixels.
        disparity: (rows, columns) float32 at the cells' centres; interpolated bilinearly.
        cell: side of a cell, pixels: 1, 2 or 4.
        scale: factor from `disparity` to pixels of these images.
        out: (9, rows, columns) float32 buffer for the result; None allocates it.
    """
    if out is None:
        out = np.empty((9, *disparity.shape), dtype=np.float32)
    rows = disparity.shape[0]
    parallel_rows(_sum_cells, rows, left, right, disparity, cell, np.float32(scale), out)
    return CellSums(*out)


# Each stage is one loop over views of a row, which the compiler vectorises. The four pixels around
# a sampling position are packed into one 32-bit word.


@njit(nogil=True, fastmath=True)
def upsample_row(
    y: int, disparity: Grid, scale: np.float32, cell: int, line: Grid, row: Grid
) -> None:
    """Interpolate the disparity of image row y into `row`; `line` is a padded buffer of cells."""
    rows, columns = disparity.shape
    i = y // cell
    down = np.float32((y - i * cell + 0.5) / cell - 0.5)
    above, below = i, min(i + 1, rows - 1)
    if down < 0.0:
        above, below, down = max(i - 1, 0), i, down + np.float32(1.0)
    first, second, inner = disparity[above], disparity[below], line[1 : columns + 1]
    for x in range(columns):
        inner[x] = scale * (first[x] + down * (second[x] - first[x]))
    line[0], line[columns + 1] = line[1], line[columns]
    before, after = line[:columns], line[2:]
    for j in range(cell):
        aside = np.float32((j + 0.5) / cell - 0.5)
        to = row[j::cell]
        if aside >= 0.0:
            for x in range(columns):
                to[x] = inner[x] + aside * (after[x] - inner[x])
        else:
            for x in range(columns):
                to[x] = inner[x] + aside * (inner[x] - before[x])


@njit(nogil=True, fastmath=True)
def _place(row: Grid, at: NDArray[np.int32], share: Grid, seen: Grid) -> None:
    """Compute the position of each left pixel in the right row: index, fraction, and seen flag."""
    one, zero, last = np.float32(1.0), np.float32(0.0), np.float32(row.size - 3)
    for x in range(row.size):
        wanted = np.float32(x) - row[x]
        place = min(max(wanted, one), last)
        whole = np.int32(place)
        at[x] = whole
        share[x] = place - np.float32(whole)
        seen[x] = one if place == wanted else zero


@njit(nogil=True, fastmath=True)
def _pack(pixels: Image, packed: NDArray[np.uint32]) -> None:
    """Pack the pixels k - 1 to k + 2 into one word, for every k."""
    n = pixels.size
    a, b, c, d = pixels[: n - 3], pixels[1 : n - 2], pixels[2 : n - 1], pixels[3:]
    to = packed[1 : n - 2]
    eight, sixteen, many = np.uint32(8), np.uint32(16), np.uint32(24)
    for x in range(n - 3):
        low = np.uint32(a[x]) | (np.uint32(b[x]) << eight)
        to[x] = low | (np.uint32(c[x]) << sixteen) | (np.uint32(d[x]) << many)


@njit(nogil=True, fastmath=True)
def _take(packed: NDArray[np.uint32], at: NDArray[np.int32], taps: NDArray[np.uint32]) -> None:
    for x in range(at.size):
        taps[x] = packed[np.uint32(at[x])]


@njit(nogil=True, fastmath=True)
def _spline(taps: NDArray[np.uint32], share: Grid, value: Grid, slope: Grid, seen: Grid) -> None:
    """Evaluate the cubic B-spline and its derivative at each position in the right row."""
    half, sixth = np.float32(0.5), np.float32(1.0 / 6.0)
    one, two, three, four = np.float32(1), np.float32(2), np.float32(3), np.float32(4)
    byte, eight, sixteen, many = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)
    for x in range(share.size):
        f, tap = share[x], taps[x]
        f1 = one - f
        r0 = np.float32(np.int32(tap & byte))
        r1 = np.float32(np.int32((tap >> eight) & byte))
        r2 = np.float32(np.int32((tap >> sixteen) & byte))
        r3 = np.float32(np.int32(tap >> many))
        w0, w3 = f1 * f1 * f1 * sixth, f * f * f * sixth
        w1 = (four - three * f * f * (two - f)) * sixth
        w2 = one - w0 - w1 - w3
        v0, v3 = -half * f1 * f1, half * f * f
        v1 = (three * half * f - two) * f
        v2 = -(v0 + v1 + v3)
        value[x] = w0 * r0 + w1 * r1 + w2 * r2 + w3 * r3
        slope[x] = v0 * r0 + v1 * r1 + v2 * r2 + v3 * r3
        seen[x] = seen[x] * min(one, min(r1, r2))


@njit(nogil=True, fastmath=True)
def _compare(
    pixels: Image,
    value: Grid,
    slope: Grid,
    seen: Grid,
    gradient: Grid,
    error: Grid,
    mid: Grid,
    unlike: Grid,
) -> None:
    """Compute gradients, differences and means of both rows; 0 where a pixel is unseen in one."""
    n = pixels.size
    sixth, half, four, one = np.float32(1 / 6), np.float32(0.5), np.float32(4), np.float32(1)
    grey = np.float32(128.0)
    before, here, after = pixels[: n - 2], pixels[1 : n - 1], pixels[2:]
    v, s, on = value[1:], slope[1:], seen[1:]
    g, e, m, u = gradient[1:], error[1:], mid[1:], unlike[1:]
    for x in range(n - 2):
        a, b, c = np.float32(before[x]), np.float32(here[x]), np.float32(after[x])
        both = on[x] * min(one, b)
        on[x] = both
        smooth = (a + four * b + c) * sixth
        e[x] = both * (smooth - v[x])
        m[x] = both * (half * (smooth + v[x]) - grey)
        rise = half * (c - a)
        g[x] = both * half * (rise + s[x])
        u[x] = both * (rise - s[x])
    seen[0] = seen[n - 1] = np.float32(0.0)


@njit(nogil=True, fastmath=True, inline="always")
def _add(
    g: Grid, e: Grid, seen: Grid, mid: Grid, unlike: Grid, out: NDArray[np.float32], cell: int
) -> None:
    """Add the sums of a row of pixels to its row of cells, out (9, columns)."""
    gg, ge, sum_g, sum_e, ee = out[0], out[1], out[2], out[3], out[4]
    n, s, ss, dd = out[5], out[6], out[7], out[8]
    for x in range(gg.size):
        a = b = c = d = f = h = p = q = r = np.float32(0.0)
        for j in range(cell):
            at = x * cell + j
            a += g[at] * g[at]
            b += g[at] * e[at]
            c += g[at]
            d += e[at]
            f += e[at] * e[at]
            h += seen[at]
            p += mid[at]
            q += mid[at] * mid[at]
            r += unlike[at] * unlike[at]
        gg[x] += a
        ge[x] += b
        sum_g[x] += c
        sum_e[x] += d
        ee[x] += f
        n[x] += h
        s[x] += p
        ss[x] += q
        dd[x] += r


# A constant cell size lets the compiler unroll the loop over its pixels.


@njit(nogil=True, fastmath=True)
def _add_one(g: Grid, e: Grid, seen: Grid, mid: Grid, unlike: Grid, out: Grid) -> None:
    _add(g, e, seen, mid, unlike, out, 1)


@njit(nogil=True, fastmath=True)
def _add_two(g: Grid, e: Grid, seen: Grid, mid: Grid, unlike: Grid, out: Grid) -> None:
    _add(g, e, seen, mid, unlike, out, 2)


@njit(nogil=True, fastmath=True)
def _add_four(g: Grid, e: Grid, seen: Grid, mid: Grid, unlike: Grid, out: Grid) -> None:
    _add(g, e, seen, mid, unlike, out, 4)


@njit(nogil=True)
def _sum_cells(
    first: int,
    last: int,
    left: Image,
    right: Image,
    disparity: Grid,
    cell: int,
    scale: np.float32,
    out: NDArray[np.float32],
) -> None:
    columns = disparity.shape[1]
    width = columns * cell
    line, row = np.empty(columns + 2, np.float32), np.empty(width, np.float32)
    at, share = np.empty(width, np.int32), np.empty(width, np.float32)
    packed, taps = np.zeros(width, np.uint32), np.zeros(width, np.uint32)
    value, slope = np.empty(width, np.float32), np.empty(width, np.float32)
    g, e = np.zeros(width, np.float32), np.zeros(width, np.float32)
    seen, mid = np.zeros(width, np.float32), np.zeros(width, np.float32)
    unlike = np.zeros(width, np.float32)
    for i in range(first, last):
        cells = out[:, i]
        cells[:] = np.float32(0.0)
        for y in range(i * cell, (i + 1) * cell):
            upsample_row(y, disparity, scale, cell, line, row)
            _place(row, at, share, seen)
            _pack(right[y], packed)
            _take(packed, at, taps)
            _spline(taps, share, value, slope, seen)
            _compare(left[y], value, slope, seen, g, e, mid, unlike)
            if cell == 4:
                _add_four(g, e, seen, mid, unlike, cells)
            elif cell == 2:
                _add_two(g, e, seen, mid, unlike, cells)
            else:
                _add_one(g, e, seen, mid, unlike, cells)
