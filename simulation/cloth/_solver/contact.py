"""Kernels of self-contact: search of close node-triangle pairs, and their separation."""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.simulation.cloth._solver.yarns import Rows
from unwrinkle.simulation.cloth.layout import offset

_X, _Y, _Z, _W = offset("x"), offset("y"), offset("z"), offset("w")
_PX, _PY, _PZ = offset("px"), offset("py"), offset("pz")
OVERFLOW = -1
#: Cells of the search grid per node above which the positions have diverged; a flat cloth has
#: about one.
MOST_CELLS = 64


@njit(nogil=True, error_model="numpy", inline="always")
def _closest(
    ab: tuple[float, float, float],
    ac: tuple[float, float, float],
    ap: tuple[float, float, float],
) -> tuple[float, float]:
    """Return (v, w) of the triangle's point a + v ab + w ac closest to p.

    Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    d1 = ab[0] * ap[0] + ab[1] * ap[1] + ab[2] * ap[2]
    d2 = ac[0] * ap[0] + ac[1] * ap[1] + ac[2] * ap[2]
    aa = ab[0] * ab[0] + ab[1] * ab[1] + ab[2] * ab[2]
    cc = ac[0] * ac[0] + ac[1] * ac[1] + ac[2] * ac[2]
    bc = ab[0] * ac[0] + ab[1] * ac[1] + ab[2] * ac[2]
    d3, d4 = d1 - aa, d2 - bc
    d5, d6 = d1 - bc, d2 - cc
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6)
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w
    area = va + vb + vc
    return vb / area, vc / area


@njit(nogil=True, error_model="numpy")
def find_pairs(
    rows: Rows,
    nodes: NDArray[np.uint64],
    rest: NDArray[np.float64],
    triangles: NDArray[np.uint64],
    centres: NDArray[np.float64],
    apart: float,
    reach: float,
    cell: float,
    pairs: NDArray[np.uint64],
    sides: NDArray[np.float64],
) -> int:
    """List the node-triangle pairs closer than `reach`; return their number, or OVERFLOW.

    Pairs closer than `apart` in the flat cloth are neighbours and are skipped. The node's side of
    the triangle is stored, so that `separate` pushes it back to that side. OVERFLOW: too many
    pairs, or diverged positions.

    Args:
        rows: the cloth.
        nodes: (n,) indices of the nodes in `rows`.
        rest: (n, 2) nodes in the flat cloth, m.
        triangles: (m, 3) indices of the corners in `rows`.
        centres: (m, 2) centroids of the triangles in the flat cloth, m.
        apart: m.
        reach: m.
        cell: side of a cell of the search grid, m; at least one node spacing.
        pairs: output (most, 2): node's index in `rows`, triangle's number.
        sides: output (most,): +1 or -1.
    """
    count = nodes.shape[0]
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for k in range(count):
        x, y = rows[_X + nodes[k]], rows[_Y + nodes[k]]
        if not (abs(x) < np.inf and abs(y) < np.inf):
            return OVERFLOW
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    wide, deep = (high_x - low_x) / cell + 1.0, (high_y - low_y) / cell + 1.0
    if not wide * deep <= MOST_CELLS * count:
        return OVERFLOW
    across, along = int(wide), int(deep)
    first = np.zeros(across * along + 1, np.int32)
    bins = np.empty(count, np.int32)
    for k in range(count):
        column = int((rows[_X + nodes[k]] - low_x) / cell)
        bins[k] = column * along + int((rows[_Y + nodes[k]] - low_y) / cell)
        first[bins[k] + 1] += 1
    for k in range(across * along):
        first[k + 1] += first[k]
    fill = first.copy()
    order = np.empty(count, np.int32)
    for k in range(count):
        order[fill[bins[k]]] = k
        fill[bins[k]] += 1
    found = 0
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = rows[_X + a], rows[_Y + a], rows[_Z + a]
        bx, by, bz = rows[_X + b], rows[_Y + b], rows[_Z + b]
        cx, cy, cz = rows[_X + c], rows[_Y + c], rows[_Z + c]
        z_low, z_high = min(az, bz, cz) - reach, max(az, bz, cz) + reach
        x_low, x_high = min(ax, bx, cx) - reach, max(ax, bx, cx) + reach
        y_low, y_high = min(ay, by, cy) - reach, max(ay, by, cy) + reach
        column_low = max(0, int((x_low - low_x) / cell))
        column_high = min(across - 1, int((x_high - low_x) / cell))
        row_low = max(0, int((y_low - low_y) / cell))
        row_high = min(along - 1, int((y_high - low_y) / cell))
        for column in range(column_low, column_high + 1):
            begin = first[column * along + row_low]
            end = first[column * along + row_high + 1]
            for q in range(begin, end):
                k = order[q]
                du, dv = rest[k, 0] - centres[t, 0], rest[k, 1] - centres[t, 1]
                if du * du + dv * dv < apart * apart:
                    continue
                p = nodes[k]
                x, y, z = rows[_X + p], rows[_Y + p], rows[_Z + p]
                if z < z_low or z > z_high or x < x_low or x > x_high or y < y_low or y > y_high:
                    continue
                ab = (bx - ax, by - ay, bz - az)
                ac = (cx - ax, cy - ay, cz - az)
                ap = (x - ax, y - ay, z - az)
                v, w = _closest(ab, ac, ap)
                dx = ap[0] - v * ab[0] - w * ac[0]
                dy = ap[1] - v * ab[1] - w * ac[1]
                dz = ap[2] - v * ab[2] - w * ac[2]
                if dx * dx + dy * dy + dz * dz >= reach * reach:
                    continue
                if found == pairs.shape[0]:
                    return OVERFLOW
                side = (
                    dx * (ab[1] * ac[2] - ab[2] * ac[1])
                    + dy * (ab[2] * ac[0] - ab[0] * ac[2])
                    + dz * (ab[0] * ac[1] - ab[1] * ac[0])
                )
                sides[found] = 1.0 if side >= 0.0 else -1.0
                pairs[found, 0] = p
                pairs[found, 1] = t
                found += 1
    return found


@njit(nogil=True, error_model="numpy")
def separate(
    rows: Rows,
    triangles: NDArray[np.uint64],
    pairs: NDArray[np.uint64],
    sides: NDArray[np.float64],
    found: int,
    thickness: float,
    friction: float,
) -> None:
    """Push each listed node to `thickness` from its triangle, on its side, with friction."""
    for q in range(found):
        p, t = pairs[q, 0], pairs[q, 1]
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = rows[_X + a], rows[_Y + a], rows[_Z + a]
        ab = (rows[_X + b] - ax, rows[_Y + b] - ay, rows[_Z + b] - az)
        ac = (rows[_X + c] - ax, rows[_Y + c] - ay, rows[_Z + c] - az)
        ap = (rows[_X + p] - ax, rows[_Y + p] - ay, rows[_Z + p] - az)
        v, w = _closest(ab, ac, ap)
        u = 1.0 - v - w
        dx = ap[0] - v * ab[0] - w * ac[0]
        dy = ap[1] - v * ab[1] - w * ac[1]
        dz = ap[2] - v * ab[2] - w * ac[2]
        squared = dx * dx + dy * dy + dz * dz
        if squared > 4.0 * thickness * thickness:
            continue
        if u > 1e-9 and v > 1e-9 and w > 1e-9:
            nx = ab[1] * ac[2] - ab[2] * ac[1]
            ny = ab[2] * ac[0] - ab[0] * ac[2]
            nz = ab[0] * ac[1] - ab[1] * ac[0]
            scale = sides[q] / (np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-30)
        else:
            nx, ny, nz = dx, dy, dz
            scale = 1.0 / (np.sqrt(squared) + 1e-30)
        nx *= scale
        ny *= scale
        nz *= scale
        depth = thickness - (dx * nx + dy * ny + dz * nz)
        if depth <= 0.0:
            continue
        depth = min(depth, 0.5 * thickness)  # limit per substep: avoids jumps after penetration
        wp, wa, wb, wc = rows[_W + p], u * rows[_W + a], v * rows[_W + b], w * rows[_W + c]
        mobility = wp + u * wa + v * wb + w * wc
        if mobility == 0.0:
            continue
        # Tangential motion of the node over this substep, which friction reverses.
        rx = rows[_X + p] - rows[_PX + p] - u * (rows[_X + a] - rows[_PX + a])
        ry = rows[_Y + p] - rows[_PY + p] - u * (rows[_Y + a] - rows[_PY + a])
        rz = rows[_Z + p] - rows[_PZ + p] - u * (rows[_Z + a] - rows[_PZ + a])
        rx -= v * (rows[_X + b] - rows[_PX + b]) + w * (rows[_X + c] - rows[_PX + c])
        ry -= v * (rows[_Y + b] - rows[_PY + b]) + w * (rows[_Y + c] - rows[_PY + c])
        rz -= v * (rows[_Z + b] - rows[_PZ + b]) + w * (rows[_Z + c] - rows[_PZ + c])
        along = rx * nx + ry * ny + rz * nz
        rx -= along * nx
        ry -= along * ny
        rz -= along * nz
        slid = np.sqrt(rx * rx + ry * ry + rz * rz)
        taken = min(1.0, friction * depth / (slid + 1e-30))
        ix = (depth * nx - taken * rx) / mobility
        iy = (depth * ny - taken * ry) / mobility
        iz = (depth * nz - taken * rz) / mobility
        rows[_X + p] += wp * ix
        rows[_Y + p] += wp * iy
        rows[_Z + p] += wp * iz
        rows[_X + a] -= wa * ix
        rows[_Y + a] -= wa * iy
        rows[_Z + a] -= wa * iz
        rows[_X + b] -= wb * ix
        rows[_Y + b] -= wb * iy
        rows[_Z + b] -= wb * iz
        rows[_X + c] -= wc * ix
        rows[_Y + c] -= wc * iy
        rows[_Z + c] -= wc * iz
