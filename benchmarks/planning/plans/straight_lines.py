"""How far samples of straight joint lines lie off them.

Of plans' transits, and of random lines at several speeds.
"""

from itertools import pairwise

import numpy as np

from benchmarks.planning.plans.results import LineFigures
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.search.planner import PlanResult
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.timing.sampling import sampling_period, sent_ratios
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.planning.trajectory import Trajectory

#: Fractions of the catalogue speed.
SPEEDS = (0.1, 0.2, 0.5, 1.0)
#: A sample further off its line than this counts as off, rad.
OFF = 1e-9


def line_deviation(result: PlanResult) -> float:
    """Greatest distance of a plan's transit samples from the lines that were checked for collision,
    rad.
    """
    plan = result.plan
    if plan is None:
        return 0.0
    there, back = result.transits
    first, last = plan.segments[0], plan.segments[-1]
    t = first.trajectory.times
    ways = [(first.trajectory.positions[t <= first.contact[0] + 1e-9], there.points)]
    t = last.trajectory.times
    ways.append((last.trajectory.positions[t >= last.contact[1] - 1e-9], back.points))
    return max(_off(samples, points) for samples, points in ways)


def random_lines(cell: Cell, seed: int, count: int) -> tuple[LineFigures, ...]:
    """Time random lines through the whole joint space, every other one a tenth as long.

    Per speed how well they are kept.
    """
    settings, rows = PlannerSettings(), []
    for speed in SPEEDS:
        limits = cell.with_speed(speed).limits
        rng = np.random.default_rng(seed)
        period = sampling_period(settings.sample_time, speed)
        off, worst = [], np.zeros(3)
        for i in range(count):
            start, goal = rng.uniform(limits.lower, limits.upper, (2, len(limits.lower)))
            goal = goal if i % 2 else start + 0.1 * (goal - start)
            t, q, v, _ = time_line(start, goal, limits, settings.margin, period)
            off.append(_off(q, np.array([start, goal])))
            sent = as_sent(Trajectory(t, q, v))
            ratios = sent_ratios(sent.times, sent.positions, sent.velocities, limits)
            worst = np.maximum(worst, ratios)
        rows.append(
            LineFigures(
                speed=speed,
                period=period,
                lines=count,
                off=sum(value > OFF for value in off),
                deviation_max=max(off),
                worst_velocity_ratio_sent=float(worst[0]),
                worst_acceleration_ratio_sent=float(worst[1]),
                worst_jerk_ratio_sent=float(worst[2]),
            )
        )
    return tuple(rows)


def _off(samples: Array, points: Array) -> float:
    """Greatest distance of samples (N, n) from the nearest leg of a polyline (M, n), rad, of any
    axis.
    """
    nearest = np.full(len(samples), np.inf)
    for a, b in pairwise(points):
        way = b - a
        square = float(way @ way)
        share = (samples - a) @ way / square if square > 0.0 else np.zeros(len(samples))
        foot = a + np.clip(share, 0.0, 1.0)[:, None] * way
        nearest = np.minimum(nearest, np.abs(samples - foot).max(axis=1))
    return float(nearest.max(initial=0.0))
