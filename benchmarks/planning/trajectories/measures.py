"""One judge for every way of timing a path: the samples, with the cubics that the controller runs
between them.

Velocity and acceleration are exact extremes of the cubics, as in the verification of a plan. Jerk
is the greater of the cubics' own and the change of mean acceleration between neighbouring intervals
over their length, rest before and after included: where acceleration jumps, as without a jerk
limit, that grows without bound with the sampling rate.
"""

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

from benchmarks.planning.trajectories.methods import Failure, Result, Samples
from benchmarks.planning.trajectories.paths import Piece
from benchmarks.planning.trajectories.results import Judgement, PieceFailure
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.verification.joint_limits import TOLERANCE
from unwrinkle.planning.verification.motion import Leg

QUANTITIES = ("velocity", "acceleration", "jerk", "tip_speed")
#: A deviation below this counts as none, m: a hundredth of the least thing that the planner leaves
#: between bodies on purpose.
NO_DEVIATION = 1e-5

_CURVE = 2000  # points of a dense path
_BETWEEN = 4  # looks at the motion per sample interval


def judge(
    pieces: tuple[Piece, ...], result: Result, limits: Limits, kinematics: Kinematics
) -> Judgement:
    """Judge one method on one path, over all its pieces.

    Args:
        pieces: of the path.
        result: what the method gave for each.
        limits: full limits.
        kinematics: of the tool centre points.
    """
    failures = [
        PieceFailure(piece.name, samples.reason)
        for piece, samples in zip(pieces, result, strict=True)
        if isinstance(samples, Failure)
    ]
    if failures:
        return Judgement(failures=tuple(failures), ratio={}, violations={})
    solved = [
        (piece, samples)
        for piece, samples in zip(pieces, result, strict=True)
        if not isinstance(samples, Failure)
    ]
    rows = [_judge_piece(piece, samples, limits, kinematics) for piece, samples in solved]
    durations = [float(samples[0][-1]) for _, samples in solved]
    return Judgement(
        duration=sum(durations),
        durations=tuple(durations),
        ratio={name: max(row.ratio[name] for row in rows) for name in QUANTITIES},
        violations={name: sum(row.violations[name] for row in rows) for name in QUANTITIES},
        deviation=max(row.deviation for row in rows),
        joint_deviation=max(row.joint_deviation for row in rows),
    )


def _judge_piece(
    piece: Piece, samples: Samples, limits: Limits, kinematics: Kinematics
) -> Judgement:
    ratios = limit_ratios(samples, limits)
    t, q, v = samples
    fine = np.unique(np.linspace(t[:-1], t[1:], _BETWEEN + 1).ravel())
    taken = CubicHermiteSpline(t, q, v)(fine)
    tips = kinematics.tcp_positions(taken)
    speed = np.linalg.norm(np.diff(tips, axis=0), axis=2) / np.diff(fine)[:, None]
    ratios["tip_speed"] = speed / limits.tip_speed_holding if piece.holding else np.zeros((1, 2))
    curve = piece.path().spline(np.linspace(0.0, 1.0, _CURVE))
    curve_tips = kinematics.tcp_positions(curve)
    away = [np.linalg.norm(offsets(tips[:, arm], curve_tips[:, arm]), axis=1) for arm in (0, 1)]
    return Judgement(
        ratio={name: float(x.max()) for name, x in ratios.items()},
        violations={name: int(np.sum(x > 1.0 + TOLERANCE)) for name, x in ratios.items()},
        deviation=float(max(x.max() for x in away)),
        joint_deviation=float(np.abs(offsets(taken, curve)).max()),
    )


def limit_ratios(samples: Samples, limits: Limits) -> dict[str, Array]:
    """Velocity, acceleration and jerk over their limits in every interval (M, n), absolute."""
    t, q, v = samples
    leg = Leg("", t, q, v, False, None)
    mean = np.diff(v, axis=0) / leg.step
    rest = np.zeros((1, q.shape[1]))
    change = np.diff(np.vstack([rest, mean, rest]), axis=0)
    jumps = np.abs(change) / np.vstack([leg.step[:1], leg.step])
    jerk = np.maximum(np.abs(leg.jerk), np.maximum(jumps[:-1], jumps[1:]))
    return {
        "velocity": leg.greatest_velocity / limits.velocity,
        "acceleration": leg.greatest_acceleration / limits.acceleration,
        "jerk": jerk / limits.jerk,
    }


def offsets(points: Array, curve: Array) -> Array:
    """From the nearest point of a polyline to each point, (N, d), for points (N, d) and corners (M,
    d).
    """
    _, near = cKDTree(curve).query(points)
    best = points - curve[near]
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(curve) - 2)):
        a, along = curve[first], curve[first + 1] - curve[first]
        length = np.maximum(np.sum(along**2, axis=1), 1e-30)
        share = np.clip(np.sum((points - a) * along, axis=1) / length, 0.0, 1.0)
        off = points - a - share[:, None] * along
        nearer = np.sum(off**2, axis=1) < np.sum(best**2, axis=1)
        best = np.where(nearer[:, None], off, best)
    return np.asarray(best)
