"""Kernels of a substep of the cloth solver, and the loop over substeps."""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.simulation.cloth._solver.contact import OVERFLOW, find_pairs, separate
from unwrinkle.simulation.cloth._solver.yarns import (
    Rows,
    U,
    bending,
    effective_masses,
    line_solver,
    normals,
)
from unwrinkle.simulation.cloth.layout import ROW, offset

_ROW = U(ROW)
_X, _Y, _Z, _W = offset("x"), offset("y"), offset("z"), offset("w")
_PX, _PY, _PZ = offset("px"), offset("py"), offset("pz")
_VX, _VY, _VZ = offset("vx"), offset("vy"), offset("vz")
_SX, _SY, _SZ = offset("sx"), offset("sy"), offset("sz")
_NEXT_I, _NEXT_J = offset("next_i"), offset("next_j")
_W0 = offset("w0")
#: Interval of the effective masses' update, substeps; tension changes slowly.
_MASS_UPDATE_INTERVAL = 4
_WEIGHT = np.array([_W], np.uint64)
_POSITION = np.array([_X, _Y, _Z], np.uint64)
_NORMAL = np.array([offset("nx"), offset("ny"), offset("nz")], np.uint64)

_yarns = line_solver("yarn", 0)
_rising = line_solver("rising", 1)
_falling = line_solver("falling", -1)
_bend = bending("bend", "rest", 0)
_bend_rising = bending("bend_rising", "rest_rising", 1)
_bend_falling = bending("bend_falling", "rest_falling", -1)


@njit(nogil=True, error_model="numpy")
def _transpose(source: Rows, target: Rows, nx: int, ny: int, channels: NDArray[np.uint64]) -> None:
    """Copy channels of `source` (nx rows) to `target`, transposed."""
    block = 8
    for channel in channels:
        for i0 in range(0, nx, block):
            for j0 in range(0, ny, block):
                for i in range(i0, min(i0 + block, nx)):
                    for j in range(j0, min(j0 + block, ny)):
                        target[channel + U(j + 1) * _ROW + U(i)] = source[
                            channel + U(i + 1) * _ROW + U(j)
                        ]


@njit(nogil=True, error_model="numpy")
def _predict(
    rows: Rows, nx: int, ny: int, step: float, gravity: tuple[float, float, float]
) -> None:
    """Store the positions and predict the new ones by velocity and gravity."""
    gx, gy, gz = gravity
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            x, y, z = rows[_X + o], rows[_Y + o], rows[_Z + o]
            rows[_PX + o] = x
            rows[_PY + o] = y
            rows[_PZ + o] = z
            free = step if rows[_W + o] > 0.0 else 0.0
            pull = step * rows[_W + o] / (rows[_W0 + o] + 1e-30)  # weight over effective mass
            rows[_X + o] = x + free * (rows[_VX + o] + pull * gx)
            rows[_Y + o] = y + free * (rows[_VY + o] + pull * gy)
            rows[_Z + o] = z + free * (rows[_VZ + o] + pull * gz)


@njit(nogil=True, error_model="numpy")
def _ground(
    rows: Rows,
    nx: int,
    ny: int,
    table: tuple[float, float, float, float, float, float, float],
    mu: float,
) -> None:
    """Project the nodes out of table and floor, with Coulomb friction.

    Friction acts on positions: within the cone a node is reset exactly to its former position, so
    that it does not creep. `table`: centre x, y, half sizes x, y, heights of a node on the table
    and on the floor, and radius of the table's rounded edge, m; nodes would catch on a sharp edge.
    """
    centre_x, centre_y, half_x, half_y, top, floor, edge = table
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            x, y, z = rows[_X + o], rows[_Y + o], rows[_Z + o]
            px, py, pz = rows[_PX + o], rows[_PY + o], rows[_PZ + o]
            ax, ay = x - centre_x, y - centre_y
            # Distance beyond the flat part of the top, and above the start of the rounding.
            out_x = max(0.0, abs(ax) - (half_x - edge))
            out_y = max(0.0, abs(ay) - (half_y - edge))
            out = np.sqrt(out_x * out_x + out_y * out_y)
            above = max(0.0, z - (top - edge))
            reach = np.sqrt(out * out + above * above) + 1e-30
            depth = edge - reach if out > 0.0 else top - z
            on_table = depth > 0.0
            rounded = on_table and out > 0.0
            nx_ = (out_x if ax > 0.0 else -out_x) / reach if rounded else 0.0
            ny_ = (out_y if ay > 0.0 else -out_y) / reach if rounded else 0.0
            nz_ = above / reach if rounded else 1.0
            depth = depth if on_table else floor - z
            touches = depth > 0.0 and rows[_W + o] > 0.0
            tx = x + depth * nx_ - px
            ty = y + depth * ny_ - py
            tz = z + depth * nz_ - pz
            normal = tx * nx_ + ty * ny_ + tz * nz_
            tx -= normal * nx_
            ty -= normal * ny_
            tz -= normal * nz_
            slid = np.sqrt(tx * tx + ty * ty + tz * tz) + 1e-30
            kept = max(0.0, 1.0 - mu * depth / slid)
            rows[_X + o] = px + normal * nx_ + kept * tx if touches else x
            rows[_Y + o] = py + normal * ny_ + kept * ty if touches else y
            rows[_Z + o] = pz + normal * nz_ + kept * tz if touches else z


@njit(nogil=True, error_model="numpy")
def _velocities(
    rows: Rows, nx: int, ny: int, step: float, drag: float, viscosity: float, most: float
) -> None:
    """Compute the velocities from the positions, with air drag, speed limit and viscosity.

    `viscosity` is the diffusion number D dt / h^2. It acts on velocity differences of neighbouring
    nodes, so that it does not damp rigid motion.
    """
    slowed = 1.0 / (step * (1.0 + drag * step))
    one = U(1)
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            vx = (rows[_X + o] - rows[_PX + o]) * slowed
            vy = (rows[_Y + o] - rows[_PY + o]) * slowed
            vz = (rows[_Z + o] - rows[_PZ + o]) * slowed
            speed = np.sqrt(vx * vx + vy * vy + vz * vz)
            share = most / max(speed, most)
            rows[_VX + o] = vx * share
            rows[_VY + o] = vy * share
            rows[_VZ + o] = vz * share
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            down, up, right, left = o + _ROW, o - _ROW, o + one, o - one
            a, b = rows[_NEXT_I + o], rows[_NEXT_I + up]
            c, d = rows[_NEXT_J + o], rows[_NEXT_J + left]
            n = a + b + c + d
            rows[_SX + o] = (a * rows[_VX + down] + b * rows[_VX + up] + c * rows[_VX + right]) + (
                d * rows[_VX + left] - n * rows[_VX + o]
            )
            rows[_SY + o] = (a * rows[_VY + down] + b * rows[_VY + up] + c * rows[_VY + right]) + (
                d * rows[_VY + left] - n * rows[_VY + o]
            )
            rows[_SZ + o] = (a * rows[_VZ + down] + b * rows[_VZ + up] + c * rows[_VZ + right]) + (
                d * rows[_VZ + left] - n * rows[_VZ + o]
            )
    for i in range(1, nx + 1):
        here = U(i) * _ROW
        for column in range(ny):
            o = here + U(column)
            rows[_VX + o] += viscosity * rows[_SX + o]
            rows[_VY + o] += viscosity * rows[_SY + o]
            rows[_VZ + o] += viscosity * rows[_SZ + o]


@njit(nogil=True, error_model="numpy")
def _farthest(rows: Rows, nodes: NDArray[np.uint64], listed: NDArray[np.float64]) -> float:
    """Return the largest squared distance, m^2, of a node from its listed position (n, 3)."""
    most = 0.0
    for k in range(nodes.shape[0]):
        o = nodes[k]
        dx, dy = rows[_X + o] - listed[k, 0], rows[_Y + o] - listed[k, 1]
        dz = rows[_Z + o] - listed[k, 2]
        most = max(most, dx * dx + dy * dy + dz * dz)
    return most


@njit(nogil=True, error_model="numpy")
def substeps(
    rows: Rows,
    turned: Rows,
    yarn_j: Rows,
    nx: int,
    ny: int,
    count: int,
    step: float,
    spacing: float,
    gravity: tuple[float, float, float],
    table: tuple[float, float, float, float, float, float, float],
    bends: tuple[float, float, float],
    contact: tuple[float, float, float, float, float, float],
    damping: tuple[float, float, float],
    held: NDArray[np.uint64],
    held_from: NDArray[np.float64],
    held_to: NDArray[np.float64],
    nodes: NDArray[np.uint64],
    rest: NDArray[np.float64],
    triangles: NDArray[np.uint64],
    centres: NDArray[np.float64],
    pairs: NDArray[np.uint64],
    sides: NDArray[np.float64],
) -> int:
    """Run `count` substeps; return the number of self-contact pairs, or OVERFLOW on failure.

    Args:
        rows: state and constants of the cloth (nx rows), changed in place.
        turned: the transposed channels that the yarns along j need.
        yarn_j: see `effective_masses`.
        nx: nodes along i.
        ny: nodes along j.
        count: number of substeps.
        step: duration of a substep, s.
        spacing: of the nodes, m.
        gravity: m/s^2.
        table: see `_ground`.
        bends: slip of the straight and of the diagonal bending (m), plastic share.
        contact: table friction, thickness (m), self-friction, apart, reach, cell (m).
        damping: air drag (1/s), diffusion number, speed limit (m/s).
        held: indices of nodes that move linearly from `held_from` to `held_to` (k, 3).
        held_from: m.
        held_to: m.
        nodes: see `find_pairs`, as for the following.
        rest: m.
        triangles: places.
        centres: m.
        pairs: scratch.
        sides: scratch.
    """
    slip, slip_diagonal, share = bends
    friction, thickness, self_friction, apart, reach, cell = contact
    drag, viscosity, most = damping
    listed = np.full((nodes.shape[0], 3), 1e9)  # m, far away: the first substep builds the list
    found = 0
    diagonal = spacing * np.sqrt(2.0)
    for s in range(count):
        if s % _MASS_UPDATE_INTERVAL == 0:
            effective_masses(rows, nx, ny, spacing, yarn_j)
            _transpose(rows, turned, nx, ny, _WEIGHT)
        _predict(rows, nx, ny, step, gravity)
        part = (s + 1.0) / count
        for k in range(held.shape[0]):
            o = held[k]
            rows[_X + o] = held_from[k, 0] + part * (held_to[k, 0] - held_from[k, 0])
            rows[_Y + o] = held_from[k, 1] + part * (held_to[k, 1] - held_from[k, 1])
            rows[_Z + o] = held_from[k, 2] + part * (held_to[k, 2] - held_from[k, 2])
        normals(rows, nx, ny)
        _rising(rows, nx, ny, diagonal)
        _falling(rows, nx, ny, diagonal)
        _bend_rising(rows, nx, ny, slip_diagonal, share)
        _bend_falling(rows, nx, ny, slip_diagonal, share)
        _bend(rows, nx, ny, slip, share)
        _yarns(rows, nx, ny, spacing)
        _transpose(rows, turned, nx, ny, _POSITION)
        _transpose(rows, turned, nx, ny, _NORMAL)
        _bend(turned, ny, nx, slip, share)
        _yarns(turned, ny, nx, spacing)
        _transpose(turned, rows, ny, nx, _POSITION)
        # The list holds all pairs within reach = 2 thicknesses. It is valid until two nodes may
        # have approached by one thickness.
        if _farthest(rows, nodes, listed) > 0.25 * thickness * thickness:
            found = find_pairs(
                rows, nodes, rest, triangles, centres, apart, reach, cell, pairs, sides
            )
            if found == OVERFLOW:
                return OVERFLOW
            for k in range(nodes.shape[0]):
                listed[k, 0] = rows[_X + nodes[k]]
                listed[k, 1] = rows[_Y + nodes[k]]
                listed[k, 2] = rows[_Z + nodes[k]]
        if found > 0:
            separate(rows, triangles, pairs, sides, found, thickness, self_friction)
        _ground(rows, nx, ny, table, friction)
        _velocities(rows, nx, ny, step, drag, viscosity, most)
    return found
