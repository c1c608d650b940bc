"""How near to the optimum a jerk-limited law along a path is: a lower bound, and an independent
nonlinear programme.

The programme is a direct transcription in time, and shares neither variables nor method with the
planner's law: N equal intervals of the normalised time theta = t / T, in each the third derivative
u of the path parameter s is constant, so that s, s', s'' at the nodes are linear in u. With primes
for d/dtheta, and q_s, q_ss, ... the path's derivatives by s,

    |q_s s'| <= V T,   |q_ss s'^2 + q_s s''| <= A T^2,   |q_sss s'^3 + 3 q_ss s' s'' + q_s u| <= J T^3.

The motion's shape fixes T: it is the greatest over all rows of |v| / V, sqrt(|a| / A), cbrt(|j| /
J). That minimax problem is solved by linear programmes (HiGHS) in a trust region. As limits are
asked for at the nodes alone, the least T is, but for local optima, slightly too small: a figure
over it is on the safe side.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array, csr_array, vstack

from unwrinkle.models.arrays import Array, Indices
from unwrinkle.models.limits import Limits
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.straight_lines import time_line

_INTERVALS = 120
_STEPS = 120
_ENOUGH = 2e-5  # relative gain of an accepted step below which the method stops
_NEAR = 0.6  # rows below this part of their limit are left out of a linear programme; the trust region keeps them there
_REGION, _SMALLEST, _LARGEST = 0.05, 1e-5, 0.3


def joint_bound(q: Array, limits: Limits) -> float:
    """Least time in which every axis alone gets from rest at q[0] to rest at q[-1], s: a lower
    bound for any path.

    Args:
        q: (N, n) configurations; that an axis may turn back on the way is not counted.
        limits: of the axes.
    """
    alone = q[0] + np.diag(q[-1] - q[0])  # one row per axis, in which it alone has moved
    return max(time_line(q[0], goal, limits, 0.0, 1.0)[3] for goal in alone)


@dataclass(frozen=True, eq=False)
class _Shape:
    """A motion in normalised time: (s, s', s'') at the nodes (N+1, 3), u in the intervals (N,)."""

    states: Array
    u: Array


@dataclass(frozen=True)
class Refined:
    """What the programme found.

    Attributes:
        duration: least T that meets every limit at the nodes, s.
        dense: the same on a grid eight times finer, s.
        steps: linear programmes solved.
    """

    duration: float
    dense: float
    steps: int


class PathProgramme:
    """The nonlinear programme for one path."""

    def __init__(self, path: JointPath, limits: PathLimits, intervals: int = _INTERVALS) -> None:
        """Use a path, full limits, and a number of intervals."""
        self._path, self._limits, self._count = path, limits, intervals
        self._dynamics = self._linear_dynamics()

    def solve(self, start: Array) -> Refined:
        """Improve a law, to a local optimum.

        Args:
            start: (N+1,) values of s at equal steps of time, from 0 to 1.
        """
        shape = self._from_positions(start)
        duration, region, steps = self._duration(shape), _REGION, 0
        while steps < _STEPS and region > _SMALLEST:
            steps += 1
            trial = self._step(shape, duration, region)
            found = np.inf if trial is None else self._duration(trial)
            if trial is not None and found < duration:
                gain = 1.0 - found / duration
                shape, duration = trial, found
                region = min(2.0 * region, _LARGEST)
                if gain < _ENOUGH:
                    break
            else:
                region *= 0.3
        return Refined(duration, self._duration(_refined(shape, 8)), steps)

    def _from_positions(self, s: Array) -> _Shape:
        h = 1.0 / self._count
        first = np.gradient(s, h, edge_order=2)
        first[[0, -1]] = 0.0
        second = np.gradient(first, h, edge_order=2)
        second[[0, -1]] = 0.0
        return _Shape(np.stack([s, first, second], axis=1), np.diff(second) / h)

    def _linear_dynamics(self) -> csr_array:
        """Rows of x[k+1] - Phi x[k] - Gamma u[k] = 0.

        Columns: states node by node, then u, then T.
        """
        n, h = self._count, 1.0 / self._count
        phi = np.array([[1.0, h, h * h / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
        gamma = np.array([h**3 / 6, h * h / 2, h])
        rows, columns, values = [], [], []
        for k in range(n):
            for i in range(3):
                rows.append(3 * k + i)
                columns.append(3 * (k + 1) + i)
                values.append(1.0)
                for j in range(i, 3):
                    rows.append(3 * k + i)
                    columns.append(3 * k + j)
                    values.append(-phi[i, j])
                rows.append(3 * k + i)
                columns.append(3 * (n + 1) + k)
                values.append(-gamma[i])
        return csr_array(coo_array((values, (rows, columns)), shape=(3 * n, 4 * n + 4)))

    def _duration(self, shape: _Shape) -> float:
        v, a, j, _ = self._ratios(shape)
        return float(max(v.max(), np.sqrt(np.abs(a).max()), np.cbrt(np.abs(j).max())))

    def _ratios(self, shape: _Shape) -> tuple[Array, Array, Array, list[Array]]:
        """Velocity (signless tip speed as last column), acceleration, jerk (both ends of the
        intervals) over limits at T = 1.
        """
        s, d, e = shape.states.T[:, :, None]
        inside = np.clip(s[:, 0], 0.0, 1.0)
        q = [self._path.spline(inside, nu=k) for k in range(1, 5)]
        limits = self._limits
        v = np.abs(q[0] * d) / limits.velocity
        if limits.tip_speed is not None and self._path.tip_rate is not None:
            rate = self._path.tip_rate(inside) / limits.tip_speed
            v = np.column_stack([v, np.abs(rate * d[:, 0])])
        a = (q[1] * d**2 + q[0] * e) / limits.acceleration
        base = q[2] * d**3 + 3.0 * q[1] * d * e
        u = shape.u[:, None]
        j = np.stack([base[:-1] + q[0][:-1] * u, base[1:] + q[0][1:] * u]) / limits.jerk
        return v, a, j, q

    def _step(self, shape: _Shape, duration: float, region: float) -> _Shape | None:
        """Solution of the linear programme about a motion, in a trust region."""
        n, columns = self._count, 4 * self._count + 4
        blocks = self._linearised(shape, duration)
        scale = np.maximum(np.abs(shape.states).max(axis=0), 1.0)
        low, high = shape.states - region * scale, shape.states + region * scale
        low[:, 0], high[:, 0] = np.maximum(low[:, 0], 0.0), np.minimum(high[:, 0], 1.0)
        low[:, 1] = np.maximum(low[:, 1], 0.0)
        low[0], low[-1] = [0, 0, 0], [1, 0, 0]
        high[0], high[-1] = [0, 0, 0], [1, 0, 0]
        lower = np.concatenate([low.ravel(), np.full(n, -np.inf), [0.5 * duration]])
        upper = np.concatenate([high.ravel(), np.full(n, np.inf), [2.0 * duration]])
        cost = np.zeros(columns)
        cost[-1] = 1.0
        result = linprog(  # type: ignore[call-overload]  # the stubs know no sparse matrices
            cost,
            A_ub=csr_array(vstack([block for block, _ in blocks])),
            b_ub=np.concatenate([bound for _, bound in blocks]),
            A_eq=self._dynamics,
            b_eq=np.zeros(3 * n),
            bounds=np.column_stack([lower, upper]),
            method="highs",
        )
        if result.status != 0:
            return None
        x = np.asarray(result.x)
        return _Shape(x[: 3 * (n + 1)].reshape(-1, 3), x[3 * (n + 1) : -1])

    def _linearised(self, shape: _Shape, duration: float) -> list[tuple[coo_array, Array]]:
        """Rows and bounds of every limit about a motion."""
        n, limits, path = self._count, self._limits, self._path
        s, d, e = shape.states.T[:, :, None]
        u = shape.u[:, None]
        _, a, j, (q1, q2, q3, q4) = self._ratios(shape)
        nodes, intervals = np.arange(n + 1), np.arange(n)
        blocks = []

        def add(
            value: Array, slopes: list[Array], at: Indices, within: Indices | None, power: int
        ) -> None:
            blocks.append(_rows(shape, value, slopes, at, within, power, duration))

        width = limits.velocity
        add(q1 * d / width, [q2 * d / width, q1 / width, np.zeros_like(q1)], nodes, None, 1)
        if limits.tip_speed is not None and path.tip_rate is not None:
            inside = np.clip(s, 0.0, 1.0)
            rate = path.tip_rate(inside) / limits.tip_speed
            slope = path.tip_rate(inside, 1) / limits.tip_speed
            add(rate * d, [slope * d, rate, np.zeros_like(rate)], nodes, None, 1)
        width = limits.acceleration
        add(a, [(q3 * d**2 + q2 * e) / width, 2 * q2 * d / width, q1 / width], nodes, None, 2)
        slopes = [
            (q4 * d**3 + 3 * q3 * d * e) / limits.jerk,  # and q2 u, which is the interval's
            (3 * q3 * d**2 + 3 * q2 * e) / limits.jerk,
            3 * q2 * d / limits.jerk,
            q1 / limits.jerk,
        ]
        for side, at in enumerate((nodes[:-1], nodes[1:])):
            here = [slope[at] for slope in slopes]
            here[0] = here[0] + q2[at] * u / limits.jerk
            add(j[side], here, at, intervals, 3)
        return blocks


def _rows(
    shape: _Shape,
    value: Array,
    slopes: list[Array],
    at: Indices,
    within: Indices | None,
    power: int,
    duration: float,
) -> tuple[coo_array, Array]:
    """Rows |value + slopes . change| <= T^power, linear in T too, for those near their limit.

    Args:
        shape: the motion about which it is linear.
        value: (M, n) over the limit at T = 1.
        slopes: of it by s, s', s'' and, where `within` is given, by u; (M, n) or (M, 1) each.
        at: (M,) node of each row.
        within: (M,) interval of each row, or None.
        power: 1 velocity, 2 acceleration, 3 jerk.
        duration: T now, s.
    """
    whole = duration**power
    keep = np.abs(value) > _NEAR * whole
    count, nodes = int(np.sum(keep)), len(shape.states)
    node = np.broadcast_to(at[:, None], value.shape)[keep]
    places = [3 * node + i for i in range(3)]
    now = [shape.states[node, i] for i in range(3)]
    if within is not None:
        interval = np.broadcast_to(within[:, None], value.shape)[keep]
        places.append(3 * nodes + interval)
        now.append(shape.u[interval])
    sign = np.sign(value[keep])
    slope = [np.broadcast_to(x, value.shape)[keep] * sign for x in slopes]
    constant = np.abs(value[keep]) - np.sum(np.array(slope) * np.array(now), axis=0)
    data = np.concatenate([*(x / whole for x in slope), np.full(count, -power / duration)])
    last = 3 * nodes + len(shape.u)
    index = np.concatenate([*places, np.full(count, last)])
    rows = np.tile(np.arange(count), len(slope) + 1)
    block = coo_array((data, (rows, index)), shape=(count, last + 1))
    return block, (1.0 - power) - constant / whole


def _refined(shape: _Shape, parts: int) -> _Shape:
    """The same motion with every interval cut into equal parts."""
    n = len(shape.u)
    h = np.arange(parts)[None, :] / (n * parts)
    s, d, e = (x[:-1, None] for x in shape.states.T)
    u = shape.u[:, None]
    states = np.stack(
        [s + h * (d + h * (e / 2 + h * u / 6)), d + h * (e + h * u / 2), e + h * u], axis=-1
    ).reshape(-1, 3)
    return _Shape(np.vstack([states, shape.states[-1]]), np.repeat(shape.u, parts))
