"""Short plans and their verdicts, made without a search."""

from itertools import pairwise

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan, GripperEvent, Segment
from unwrinkle.planning.search.planner import PlanResult, Timings
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.verdict import Verdict, Violation
from unwrinkle.testing.targets import flattening_task

_DURATION = 0.5  # of a segment, s
_DWELL = 0.2  # s
_SAMPLES = 6


def smooth_motion(begin: Array, end: Array, duration: float = _DURATION) -> Trajectory:
    """Make a motion from rest to rest between two postures, cubic in time.

    Args:
        begin, end: (n,) rad.
        duration: s.
    """
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    way = np.asarray(end) - np.asarray(begin)
    smooth, slope = 3.0 * share**2 - 2.0 * share**3, 6.0 * share * (1.0 - share) / duration
    return Trajectory(duration * share[:, 0], begin + smooth * way, slope * way)


def short_plan(home: Array, name: str = "") -> FlatteningPlan:
    """Make a plan of three motions of half a second, in which all axes move alike.

    No cell would pass it: it is for what carries plans out.

    Args:
        home: (n,) posture at begin and end, rad.
        name: makes plans of other names have another hash.
    """
    steps = ((0.0, 0.2), (0.2, 0.3), (0.3, 0.0))  # rad from home
    closed = ((False, False), (True, True), (False, False))
    segments = tuple(
        Segment(
            word,
            k * (_DURATION + _DWELL),
            smooth_motion(home + first, home + last),
            closed[k],
            (),
            (0.0, 0.0),
        )
        for k, (word, (first, last)) in enumerate(
            zip(("approach", "pull", "release"), steps, strict=True)
        )
    )
    events = tuple(
        GripperEvent(segment.end, following.closed, _DWELL)
        for segment, following in pairwise(segments)
    )
    return FlatteningPlan(
        robot="",
        robot_hash="",
        limits_hash="",
        speed=1.0,
        target=flattening_task((0.0, -1.1), 0.0),
        arms=(ArmChoice(0, 0.0, 0.0, 1.0), ArmChoice(1, 0.0, 0.0, 1.0)),
        turntable=0.0,
        segments=segments,
        events=events,
        note=name,
    )


def result_of(plan: FlatteningPlan) -> PlanResult:
    """Return a planning result with a plan and no timings."""
    return PlanResult(plan, None, Timings())


def verdict_of(plan_hash: str, *problems: str) -> Verdict:
    """Return a verdict of a plan's hash; each problem is a violation, with none it passes."""
    violations = tuple(Violation("clearance", problem) for problem in problems)
    return Verdict(plan_hash, "", "", (), violations, (), np.inf, 1)
