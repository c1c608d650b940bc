"""Optimal smoothing: the jerk-limited law s(t) along a path, by an interior-point method over the
squared path speed.

The path q(s), s in [0, 1], is kept exactly; only the speed along it is chosen. With x(s) =
(ds/dt)^2 the joint derivatives are

    q_t   = q' sqrt(x)
    q_tt  = q'' x + q' x' / 2
    q_ttt = (q''' x + 3/2 q'' x' + 1/2 q' x'') sqrt(x)

(chain rule; as in the literature on path tracking with jerk limits). Velocity and acceleration
limits are convex in x; the jerk limit is not, so the method finds a local optimum. It starts from
toppra's profile, smoothed and slowed until the jerk limit holds too. Every iterate satisfies every
limit strictly, so a stop at any time leaves a usable law.

From rest with constant jerk x grows as s^(4/3), whose derivatives are unbounded. So s = 10 tau^3 -
15 tau^4 + 6 tau^5 and x = (4 tau (1 - tau))^4 w(tau), with w a positive cubic B-spline: all limits
become smooth in w, and the time is proportional to the integral of w^(-1/2) over tau.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d

from unwrinkle.models.arrays import Array
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits, TimedPath
from unwrinkle.planning.timing.toppra_profile import SpeedProfile

_COEFFICIENTS = 36
_COLLOCATION = 96
_FINE = 8 * _COLLOCATION
_GROWTH = 10.0
_GAP = 2e-3  # relative optimality gap at which the barrier method stops
_NEWTON = 4  # steps for one weight of the barrier
_WEIGHT = 300.0  # of the time against the barrier, before its first growth
_SMOOTHING = (1.0, 2.0, 4.0, 8.0)  # widths of the start's smoothing, coefficients
_START = 0.8  # share of the tightest limit that the start uses
_LEAST_RATE = 1e-6  # of the path at its ends, of its greatest rate: a start needs some
_LEAST_WEIGHT = 1e-6  # of the start's w, of its median
_TIME_FACTOR = 30.0 / 16.0  # ds/dtau over sqrt(x / w)


@dataclass(frozen=True, eq=False)
class _Basis:
    """Collocation points in tau, the spline's values and derivatives there, and the factors that
    turn w into x.
    """

    tau: Array
    values: Array  # (3, M, K): w, w', w''
    s: Array
    e0: Array
    f: Array  # (2, M)
    g: Array  # (3, M)


def _basis(tau: Array, knots: Array) -> _Basis:
    design = [BSpline(knots, np.eye(_COEFFICIENTS), 3)(tau, nu=k) for k in range(3)]
    a, b = tau, 1.0 - tau
    s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    s1, s2 = 30 * a**2 * b**2, 60 * a * b * (b - a)
    e = 256.0 * a**4 * b**4
    e1 = 1024.0 * a**3 * b**3 * (b - a)
    e2 = 1024.0 * a**2 * b**2 * (3 * (b - a) ** 2 - 2 * a * b)
    f = np.stack([e1 / s1, e / s1])
    g = np.stack([(e2 - f[0] * s2) / s1**2, (2 * e1 - f[1] * s2) / s1**2, e / s1**2])
    return _Basis(tau, np.stack(design), s, e, f, g)


_KNOTS = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, _COEFFICIENTS - 2), [1.0] * 3])
_GREVILLE = np.array([_KNOTS[i + 1 : i + 4].mean() for i in range(_COEFFICIENTS)])
_GREVILLE_S = 10 * _GREVILLE**3 - 15 * _GREVILLE**4 + 6 * _GREVILLE**5
# Limits are also kept close to both ends, where no midpoint is.
_ENDS = np.array([1e-3, 1.0 - 1e-3])
_MIDPOINTS = (np.arange(_COLLOCATION) + 0.5) / _COLLOCATION
_COARSE = _basis(np.concatenate([_ENDS, _MIDPOINTS]), _KNOTS)
_DENSE = _basis((np.arange(_FINE) + 0.5) / _FINE, _KNOTS)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Limits of P paths at the collocation points, linear in (w, w', w'') but for the jerk's factor
    sqrt(w).
    """

    velocity: Array  # (P, M): w times this at most 1
    acceleration: Array  # (P, M, n, 2)
    jerk: Array  # (P, M, n, 3)

    def ratios(self, w: Array) -> tuple[Array, Array, Array]:
        """Velocity (squared), acceleration and jerk over their limits, for w (P, 3, M)."""
        linear = w.transpose(0, 2, 1)[:, :, None, :]
        acceleration = np.sum(self.acceleration * linear[..., :2], axis=-1)
        jerk = np.sum(self.jerk * linear, axis=-1) * np.sqrt(w[:, 0, :, None])
        return self.velocity * w[:, 0], acceleration, jerk


def _rows(paths: list[JointPath], limits: list[PathLimits], basis: _Basis) -> _Rows:
    velocity, acceleration, jerk = [], [], []
    for path, limit in zip(paths, limits, strict=True):
        q1, q2, q3 = (path.spline(basis.s, nu=k) for k in (1, 2, 3))
        v = np.max((q1 / limit.velocity) ** 2, axis=1)
        if limit.tip_speed is not None and path.tip_rate is not None:
            v = np.maximum(v, (path.tip_rate(basis.s) / limit.tip_speed) ** 2)
        e, f, g = (x[..., None] for x in (basis.e0, basis.f, basis.g))
        velocity.append(basis.e0 * v)
        acceleration.append(
            np.stack([q2 * e + 0.5 * q1 * f[0], 0.5 * q1 * f[1]], -1) / limit.acceleration[:, None]
        )
        root = np.sqrt(e)
        jerk.append(
            np.stack(
                [
                    root * (q3 * e + 1.5 * q2 * f[0] + 0.5 * q1 * g[0]),
                    root * (1.5 * q2 * f[1] + 0.5 * q1 * g[1]),
                    root * 0.5 * q1 * g[2],
                ],
                -1,
            )
            / limit.jerk[:, None]
        )
    return _Rows(np.stack(velocity), np.stack(acceleration), np.stack(jerk))


@dataclass(frozen=True, eq=False)
class _Law:
    """The programme's law: tau over time, and w over tau.

    Attributes:
        duration: s.
    """

    duration: float
    _coefficients: Array
    _tau_of_time: CubicHermiteSpline

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the path parameter and its rate, 1/s, at times (N,), s."""
        tau = self._tau_of_time(times)
        s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
        x = 256.0 * (tau * (1.0 - tau)) ** 4 * BSpline(_KNOTS, self._coefficients, 3)(tau)
        return s, np.sqrt(np.maximum(x, 0.0))


def smooth_optimally(
    paths: list[JointPath],
    limits: list[PathLimits],
    profiles: list[SpeedProfile] | None = None,
) -> list[TimedPath]:
    """Find the fastest jerk-limited laws of several paths at once, each from rest to rest within
    its limits.

    Args:
        paths: all with the same number of axes.
        limits: for each.
        profiles: toppra's, for each; without them the start is a constant w, and the barrier method
            needs more steps.

    Returns:
        Timed paths whose velocity, acceleration and jerk ratios on a grid eight times finer than
        the optimisation's are at most 1.
    """
    rows = _rows(paths, limits, _COARSE)
    if profiles is None:
        constant = np.ones((len(paths), _COEFFICIENTS))
        c = _optimise(_slowed(constant, rows, 0.5), rows, _WEIGHT / _GROWTH)
    else:
        c = _optimise(_start(paths, limits, profiles, rows), rows, _WEIGHT)
    fine = _rows(paths, limits, _DENSE)
    c /= np.maximum(1.0, _worst(fine, _evaluate(c, _DENSE)))[:, None]
    return [_timed(path, coefficients) for path, coefficients in zip(paths, c, strict=True)]


def _start(
    paths: list[JointPath], limits: list[PathLimits], profiles: list[SpeedProfile], rows: _Rows
) -> Array:
    """Coefficients (P, K) of toppra's profiles, bounded near the ends, smoothed and slowed until
    every limit holds strictly.

    Of several widths of smoothing, and of a constant w, the fastest is taken for each path.
    """
    sharp = np.log([_weights(*given) for given in zip(paths, limits, profiles, strict=True)])
    candidates = [np.ones_like(sharp)]
    candidates += [np.exp(gaussian_filter1d(sharp, k, mode="nearest")) for k in _SMOOTHING]
    best, least = candidates[0], np.full(len(paths), np.inf)
    for candidate in candidates:
        c = _slowed(candidate, rows, _START)
        time = np.sum(_evaluate(c, _COARSE)[:, 0, 2:] ** -0.5, axis=1)
        best = np.where((time < least)[:, None], c, best)
        least = np.minimum(time, least)
    return best


def _slowed(c: Array, rows: _Rows, share: float) -> Array:
    """Coefficients (P, K) scaled so that the tightest limit of each path is used up to a share,
    below 1.
    """
    return np.asarray(c * (share / _worst(rows, _evaluate(c, _COARSE)))[:, None])


def _weights(path: JointPath, limits: PathLimits, profile: SpeedProfile) -> Array:
    """Values of w (K,) at the spline's Greville points, of toppra's profile and of constant jerk
    from rest at either end.

    With constant jerk j of s from rest, s = j t^3 / 6 and x = (j t^2 / 2)^2 = (6 s)^(4/3) j^(2/3) /
    4; and s is 10 tau^3 there.
    """
    s, s_left = _GREVILLE_S, _GREVILLE_S[::-1]
    rates = (np.abs(path.spline(s, nu=1)) / limits.jerk).max(axis=1)
    ends = np.maximum(rates[[0, -1]], _LEAST_RATE * rates.max())
    begin, end = ends ** (-2.0 / 3.0)
    x = np.minimum.reduce(
        [
            profile.squared_speed(s),
            0.25 * begin * (6.0 * s) ** (4.0 / 3.0),
            0.25 * end * (6.0 * s_left) ** (4.0 / 3.0),
        ]
    )
    w = np.empty(_COEFFICIENTS)
    w[1:-1] = x[1:-1] / (4.0 * _GREVILLE * (1.0 - _GREVILLE))[1:-1] ** 4
    w[0], w[-1] = (60.0 ** (4.0 / 3.0) / 1024.0) * np.array([begin, end])
    return np.maximum(w, _LEAST_WEIGHT * np.median(w))


def _evaluate(c: Array, basis: _Basis) -> Array:
    return np.einsum("dmk,pk->pdm", basis.values, c)


def _worst(rows: _Rows, w: Array) -> Array:
    """Factor (P,) by which x must be divided for every ratio to be at most 1.

    V^2 and a scale with x, jerk with x^1.5.
    """
    v, a, j = rows.ratios(w)
    return np.maximum.reduce(
        [v.max(1), np.abs(a).max((1, 2)), np.abs(j).max((1, 2)) ** (2.0 / 3.0)]
    )


def _optimise(c: Array, rows: _Rows, weight: float) -> Array:
    """Barrier method: minimise the time minus the logarithms of what is left of every limit.

    Args:
        c: coefficients (P, K) that keep every limit strictly.
        rows: the limits.
        weight: of the time, before its first growth.
    """
    values = _COARSE.values
    count = rows.velocity.shape[1] * (1 + 2 * 2 * rows.jerk.shape[2])
    w = _evaluate(c, _COARSE)
    scale = 1.0 / np.sum(w[:, 0, 2:] ** -0.5, axis=1)  # so that the objective starts at 1
    active = np.ones(len(c), dtype=bool)
    phi = values.transpose(1, 0, 2)  # (M, 3, K)
    while weight < count / _GAP:
        weight *= _GROWTH
        for _ in range(_NEWTON):
            w = _evaluate(c, _COARSE)
            value, gradient, hessian = _barrier(w, rows, weight * scale)
            g = np.einsum("pmd,mdk->pk", gradient, phi, optimize=True)
            left = np.matmul(hessian, phi[None])  # (P, M, 3, K)
            h = np.matmul(
                phi.reshape(-1, phi.shape[2]).T[None], left.reshape(len(c), -1, phi.shape[2])
            )
            h += 1e-12 * np.trace(h, axis1=1, axis2=2)[:, None, None] * np.eye(_COEFFICIENTS)
            step = -np.linalg.solve(h, g[..., None])[..., 0]
            decrement = -np.sum(g * step, axis=1)
            active = decrement > 0.3
            if not active.any():
                break
            length = np.where(active, _room(w, _evaluate(step, _COARSE), rows), 0.0)
            for _ in range(30):
                trial = c + length[:, None] * step
                new = _barrier_value(_evaluate(trial, _COARSE), rows, weight * scale)
                bad = ~(new <= value - 0.1 * length * decrement) & (length > 0.0)
                if not bad.any():
                    break
                length = np.where(bad, 0.5 * length, length)
            c = c + np.where(bad, 0.0, length)[:, None] * step
    return c


def _room(w: Array, dw: Array, rows: _Rows) -> Array:
    """Step length (P,), at most 1, that stays inside the limits to first order."""
    v, a, j = rows.ratios(w)
    linear = dw.transpose(0, 2, 1)[:, :, None, :]
    da = np.sum(rows.acceleration * linear[..., :2], axis=-1)
    root = np.sqrt(w[:, 0])[..., None]
    dj = np.sum(rows.jerk * linear, axis=-1) * root + 0.5 * j * (dw[:, 0] / w[:, 0])[..., None]
    # Fractions of what is left of each limit that the full step would use.
    used = np.maximum.reduce(
        [
            (rows.velocity * dw[:, 0] / (1.0 - v)).max(1),
            (-dw[:, 0] / w[:, 0]).max(1),
            (np.abs(da) / (1.0 - np.copysign(a, da * a))).max((1, 2)),
            (np.abs(dj) / (1.0 - np.copysign(j, dj * j))).max((1, 2)),
        ]
    )
    return np.asarray(np.minimum(1.0, 0.95 / np.maximum(used, 1e-12)))


def _barrier_value(w: Array, rows: _Rows, weight: Array) -> Array:
    """Barrier function of each path (P,); infinite outside the limits."""
    with np.errstate(invalid="ignore", divide="ignore"):
        v, a, j = rows.ratios(w)
        slack = [1.0 - v, 1.0 - a * a, 1.0 - j * j]
        inside = np.all(w[:, 0] > 0.0, axis=1)
        total = weight * np.sum(w[:, 0, 2:] ** -0.5, axis=1)
        for s in slack:
            inside &= np.all(s.reshape(len(s), -1) > 0.0, axis=1)
            total = total - np.sum(np.log(s).reshape(len(s), -1), axis=1)
    return np.where(inside, total, np.inf)


def _barrier(w: Array, rows: _Rows, weight: Array) -> tuple[Array, Array, Array]:
    """Value (P,), gradient (P, M, 3), positive definite Hessian (P, M, 3, 3) in (w, w', w'')."""
    v, a, j = rows.ratios(w)
    w0 = w[:, 0]
    value = _barrier_value(w, rows, weight)
    gradient = np.zeros((*w0.shape, 3))
    hessian = np.zeros((*w0.shape, 3, 3))
    t = weight[:, None]
    gradient[..., 0] = rows.velocity / (1.0 - v)
    gradient[:, 2:, 0] -= 0.5 * t * w0[:, 2:] ** -1.5
    hessian[..., 0, 0] = (rows.velocity / (1.0 - v)) ** 2
    hessian[:, 2:, 0, 0] += 0.75 * t * w0[:, 2:] ** -2.5
    # -log(1 - r^2): first derivative 2 r / (1 - r^2), second 2 (1 + r^2) / (1 - r^2)^2
    first, second = 2 * a / (1 - a * a), 2 * (1 + a * a) / (1 - a * a) ** 2
    gradient[..., :2] += np.einsum("pmn,pmnd->pmd", first, rows.acceleration)
    hessian[..., :2, :2] += np.matmul(
        (rows.acceleration * second[..., None]).swapaxes(-1, -2), rows.acceleration
    )
    first, second = 2 * j / (1 - j * j), 2 * (1 + j * j) / (1 - j * j) ** 2
    slope = rows.jerk * np.sqrt(w0)[..., None, None]
    slope[..., 0] += 0.5 * j / w0[..., None]
    gradient += np.einsum("pmn,pmnd->pmd", first, slope)
    hessian += np.matmul((slope * second[..., None]).swapaxes(-1, -2), slope)
    return value, gradient, hessian


def _timed(path: JointPath, coefficients: Array) -> TimedPath:
    count = 512
    edges = np.linspace(0.0, 1.0, count + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    spline = BSpline(_KNOTS, coefficients, 3)
    at_edges, at_middle = spline(edges) ** -0.5, spline(middle) ** -0.5
    steps = (at_edges[1:] + at_edges[:-1] + 4.0 * at_middle) / (6.0 * count)
    times = _TIME_FACTOR * np.concatenate([[0.0], np.cumsum(steps)])
    inverse = CubicHermiteSpline(times, edges, 1.0 / (_TIME_FACTOR * at_edges))
    return TimedPath(path, _Law(float(times[-1]), coefficients, inverse))
