"""Plans whose motion is made anew with the tools elsewhere.

Smooth, slow, within every limit, and wrong in one way.
"""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from unwrinkle.models.arrays import Array
from unwrinkle.planning.plan import FlatteningPlan, Segment
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.trajectory import Trajectory

#: Takes an arm, its tool's poses (n, 4, 4) and the share of the segment's time (n,); gives the
#: poses that it is to have.
Change = Callable[[int, Array, Array], Array]

SLOWER = 4.0
PERIOD = 0.016


def remade(
    plan: FlatteningPlan, kinematics: Kinematics, changes: dict[int, Change], slower: float = SLOWER
) -> FlatteningPlan:
    """The plan with the tools' poses in some segments changed, all of it slower, on one clock
    again.
    """
    segments, events, clock = [], [], 0.0
    for i, old in enumerate(plan.segments):
        change = changes.get(i)
        q = old.trajectory.positions if change is None else _moved(old, kinematics, change)
        segments.append(_timed(old, q, clock, slower))
        clock = segments[-1].end
        if i < len(plan.events):
            events.append(dc.replace(plan.events[i], time=clock))
            clock = round(clock + plan.events[i].dwell, 3)
    return dc.replace(plan, segments=tuple(segments), events=tuple(events))


def _moved(old: Segment, kinematics: Kinematics, change: Change) -> Array:
    t, q = old.trajectory.times, old.trajectory.positions.copy()
    for arm in (0, 1):
        own = slice(1 + 6 * arm, 7 + 6 * arm)
        X = kinematics.tcp(arm, q[:, 0], q[:, own])
        wanted = change(arm, X, t / t[-1])
        if np.array_equal(wanted, X):
            continue
        solution = kinematics.inverse(arm, q[:, 0], wanted)
        at = q[0, own].copy()
        for k in range(len(t)):
            ways = solution.q[k] - at
            ways[:, [3, 5]] = (ways[:, [3, 5]] + np.pi) % (2.0 * np.pi) - np.pi
            far = np.where(solution.found[k], np.abs(ways).max(axis=1), np.inf)
            assert far.min() < (0.3 if k else 1.0), (
                f"the changed motion of arm {arm} cannot be followed at {t[k]:.3f} s"
            )
            at = at + ways[far.argmin()]
            q[k, own] = at
    return q


def _timed(old: Segment, q: Array, start: float, slower: float) -> Segment:
    times = slower * old.trajectory.times
    path = CubicSpline(times, q, bc_type="clamped")
    count = int(np.ceil(times[-1] / PERIOD))
    t = np.round(PERIOD * np.arange(count + 1), 3)
    share = times[-1] / t[-1]
    positions, velocities = path(t * share), path(t * share, 1) * share
    positions[[0, -1]], velocities[[0, -1]] = q[[0, -1]], 0.0
    scale = slower / share
    return dc.replace(
        old,
        start=round(start, 3),
        trajectory=Trajectory(t, positions, velocities),
        poses=tuple(dc.replace(mark, time=min(mark.time * scale, t[-1])) for mark in old.poses),
        contact=(old.contact[0] * scale, min(old.contact[1] * scale, t[-1])),
    )


def bump(share: Array) -> Array:
    """0 at both ends, at rest there, and 1 in the middle."""
    return np.asarray(np.sin(np.pi * share) ** 4)


def shifted(X: Array, by: Array) -> Array:
    """Poses moved by (n, 3) in the world, m."""
    moved = X.copy()
    moved[:, :3, 3] += by
    return moved


def turned(X: Array, axis: Array, angles: Array) -> Array:
    """Poses turned in place by angles (n,) about world axes (n, 3), rad."""
    moved = X.copy()
    for k, (a, angle) in enumerate(zip(axis, angles, strict=True)):
        K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        R = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
        moved[k, :3, :3] = R @ X[k, :3, :3]
    return moved
