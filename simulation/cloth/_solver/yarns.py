"""Kernels of the internal forces of the cloth: yarns, shear and bending, along lines of nodes.

Every function runs along the rows of the layout (`layout`) and vectorises over a row.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.simulation.cloth.layout import ROW, STRIDE, offset

Rows = NDArray[np.float64]  # the layout's array, flat

U = np.uint64
_ROW, _STRIDE = U(ROW), U(STRIDE)
_X, _Y, _Z, _W = offset("x"), offset("y"), offset("z"), offset("w")
_NX, _NY, _NZ = offset("nx"), offset("ny"), offset("nz")
_UX, _UY, _UZ, _CP, _DP = (offset(name) for name in ("ux", "uy", "uz", "cp", "dp"))
_NEXT_I, _NEXT_J = offset("next_i"), offset("next_j")
_YARN, _RISING, _FALLING = offset("yarn"), offset("rising"), offset("falling")
_W0 = offset("w0")
#: Compliance above which there is no element.
_NONE = 1e30


def line_solver(channel: str, shift: int) -> Callable[[Rows, int, int, float], None]:
    """Return the kernel f(rows, nx, ny, length) of the springs (i, j) - (i + 1, j + shift).

    All springs of a line of nodes are solved jointly (Thomas' algorithm on the XPBD system, Macklin
    2016 eq. 18, linearised at the given positions). Projected one by one, springs would be no
    stiffer than mass / dt^2, about 13 N/m for a towel of 80 nodes, for any material. `length`: rest
    length, m.
    """
    compliance = offset(channel)
    down = U((ROW + shift) % 2**64)

    @njit(nogil=True, error_model="numpy")
    def solve(rows: Rows, nx: int, ny: int, length: float) -> None:
        # The scratch beside the outermost springs is never written and stays zero.
        for i in range(1, nx):
            here = U(i) * _ROW
            for column in range(ny):
                o = here + U(column)
                p = o + down
                q = o - down
                dx = rows[_X + o] - rows[_X + p]
                dy = rows[_Y + o] - rows[_Y + p]
                dz = rows[_Z + o] - rows[_Z + p]
                distance = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
                dx /= distance
                dy /= distance
                dz /= distance
                cosine = rows[_UX + q] * dx + rows[_UY + q] * dy + rows[_UZ + q] * dz
                lower = -rows[_W + o] * cosine
                # The coupling of the spring above needs this spring's direction: complete it now.
                upper = rows[_CP + q] * cosine
                rows[_CP + q] = upper
                pivot = rows[_W + o] + rows[_W + p] + rows[compliance + o] - lower * upper
                rows[_UX + o] = dx
                rows[_UY + o] = dy
                rows[_UZ + o] = dz
                rows[_CP + o] = -rows[_W + p] / pivot
                rows[_DP + o] = (length - distance - lower * rows[_DP + q]) / pivot
        for k in range(1, nx):
            here = U(nx - k) * _ROW
            for column in range(ny):
                o = here + U(column)
                p = o + down
                impulse = rows[_DP + o] - rows[_CP + o] * rows[_DP + p]
                rows[_DP + o] = impulse
                a = impulse * rows[_W + o]
                b = impulse * rows[_W + p]
                ux = rows[_UX + o]
                uy = rows[_UY + o]
                uz = rows[_UZ + o]
                rows[_X + o] += a * ux
                rows[_Y + o] += a * uy
                rows[_Z + o] += a * uz
                rows[_X + p] -= b * ux
                rows[_Y + p] -= b * uy
                rows[_Z + p] -= b * uz

    return solve


def bending(
    channel: str, memory: str, shift: int
) -> Callable[[Rows, int, int, float, float], None]:
    """Return the kernel f(rows, nx, ny, slip, share) of bending along (1, shift).

    The second difference c of the three positions is projected towards share * rest * normal.
    `rest` follows c along the normal if they differ by more than `slip` (m): an elasto-plastic
    (Jenkin) element with `share` of the total stiffness, parallel to an elastic one.
    """
    compliance = offset(channel)
    rest = offset(memory)
    down = U((ROW + shift) % 2**64)

    @njit(nogil=True, error_model="numpy")
    def bend(rows: Rows, nx: int, ny: int, slip: float, share: float) -> None:
        for i in range(2, nx):
            here = U(i) * _ROW
            for column in range(ny):
                b = here + U(column)
                a = b - down
                c = b + down
                cx = rows[_X + a] - 2.0 * rows[_X + b] + rows[_X + c]
                cy = rows[_Y + a] - 2.0 * rows[_Y + b] + rows[_Y + c]
                cz = rows[_Z + a] - 2.0 * rows[_Z + b] + rows[_Z + c]
                nx_, ny_, nz_ = rows[_NX + b], rows[_NY + b], rows[_NZ + b]
                s = cx * nx_ + cy * ny_ + cz * nz_
                t = min(max(rows[rest + b], s - slip), s + slip)
                t = t if rows[compliance + b] < _NONE else 0.0
                rows[rest + b] = t
                t *= share
                wa, wb, wc = rows[_W + a], rows[_W + b], rows[_W + c]
                impulse = -1.0 / (wa + 4.0 * wb + wc + rows[compliance + b])
                cx = impulse * (cx - t * nx_)
                cy = impulse * (cy - t * ny_)
                cz = impulse * (cz - t * nz_)
                rows[_X + a] += wa * cx
                rows[_Y + a] += wa * cy
                rows[_Z + a] += wa * cz
                rows[_X + b] -= 2.0 * wb * cx
                rows[_Y + b] -= 2.0 * wb * cy
                rows[_Z + b] -= 2.0 * wb * cz
                rows[_X + c] += wc * cx
                rows[_Y + c] += wc * cy
                rows[_Z + c] += wc * cz

    return bend


@njit(nogil=True, error_model="numpy")
def normals(rows: Rows, nx: int, ny: int) -> None:
    """Compute unit normals: cross product of i and j differences, one-sided at the border."""
    one = U(1)
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            down, up, right, left = o + _ROW, o - _ROW, o + one, o - one
            a, b = rows[_NEXT_I + o], rows[_NEXT_I + up]
            c, d = rows[_NEXT_J + o], rows[_NEXT_J + left]
            ux = a * (rows[_X + down] - rows[_X + o]) + b * (rows[_X + o] - rows[_X + up])
            uy = a * (rows[_Y + down] - rows[_Y + o]) + b * (rows[_Y + o] - rows[_Y + up])
            uz = a * (rows[_Z + down] - rows[_Z + o]) + b * (rows[_Z + o] - rows[_Z + up])
            vx = c * (rows[_X + right] - rows[_X + o]) + d * (rows[_X + o] - rows[_X + left])
            vy = c * (rows[_Y + right] - rows[_Y + o]) + d * (rows[_Y + o] - rows[_Y + left])
            vz = c * (rows[_Z + right] - rows[_Z + o]) + d * (rows[_Z + o] - rows[_Z + left])
            x = uy * vz - uz * vy
            y = uz * vx - ux * vz
            z = ux * vy - uy * vx
            length = np.sqrt(x * x + y * y + z * z + 1e-30)
            rows[_NX + o] = x / length
            rows[_NY + o] = y / length
            rows[_NZ + o] = z / length


@njit(nogil=True, error_model="numpy")
def effective_masses(rows: Rows, nx: int, ny: int, length: float, yarn_j: Rows) -> None:
    """Compute the effective masses that stabilise taut nodes against transverse oscillation.

    A taut line of nodes has the transverse stiffness 4 T / h per node. The springs' directions are
    those of the predicted positions, which is stable only for 4 T dt^2 / (h m) < 4/3. Therefore
    twice the sum of T dt^2 / h over a node's springs is added to its mass (as in Andrews 2017,
    "Geometric stiffness for real-time constrained multibody dynamics", with a scalar). Weight, and
    with it every equilibrium, is unchanged. `length`: rest length of a yarn's spring, m. `yarn_j`:
    compliances / dt^2 of the springs (i, j) - (i, j + 1), in the same rows, (nx + 2) * STRIDE.
    """
    diagonal = length * np.sqrt(2.0)
    one = U(1)
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        along = U(i) * _STRIDE
        for column in range(ny):
            o = here + U(column)
            x, y, z = rows[_X + o], rows[_Y + o], rows[_Z + o]
            p = o + _ROW
            d = np.sqrt((rows[_X + p] - x) ** 2 + (rows[_Y + p] - y) ** 2 + (rows[_Z + p] - z) ** 2)
            rows[_UX + o] = max(0.0, d - length) / (rows[_YARN + o] * length)
            p = o + one
            d = np.sqrt((rows[_X + p] - x) ** 2 + (rows[_Y + p] - y) ** 2 + (rows[_Z + p] - z) ** 2)
            rows[_UY + o] = max(0.0, d - length) / (yarn_j[along + U(column)] * length)
            p = o + _ROW + one
            d = np.sqrt((rows[_X + p] - x) ** 2 + (rows[_Y + p] - y) ** 2 + (rows[_Z + p] - z) ** 2)
            rows[_UZ + o] = max(0.0, d - diagonal) / (rows[_RISING + o] * diagonal)
            p = o + _ROW - one
            d = np.sqrt((rows[_X + p] - x) ** 2 + (rows[_Y + p] - y) ** 2 + (rows[_Z + p] - z) ** 2)
            rows[_DP + o] = max(0.0, d - diagonal) / (rows[_FALLING + o] * diagonal)
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            up = o - _ROW
            taut = (rows[_UX + o] + rows[_UX + up]) + (rows[_UY + o] + rows[_UY + o - one])
            taut += rows[_UZ + o] + rows[_UZ + up - one]
            taut += rows[_DP + o] + rows[_DP + up + one]
            free = rows[_W0 + o]
            rows[_W + o] = free / (1.0 + 2.0 * taut * free)
