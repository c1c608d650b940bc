"""Compare a recorded motion with its plan."""

import numpy as np

from unwrinkle.closed_loop.executed_motion import ExecutionCheck, MeasuredSegment, check_execution
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.runs.records import MotionRecord, SegmentMark

#: Displacement above which the robot counts as moved, rad.
_MOVED = 2e-4
#: Number of samples of a planned trajectory.
_FINE = 2001


def check_motion(motion: MotionRecord, plan: FlatteningPlan, cell: Cell) -> ExecutionCheck | None:
    """Compare a recorded motion with its plan, including approach and retreat.

    Returns:
        None if nothing was recorded.
    """
    parts = [_measured(motion, mark, plan) for mark in motion.segments]
    measured = [part for part in parts if part is not None]
    return check_execution(plan, cell, measured) if measured else None


def _measured(
    motion: MotionRecord, mark: SegmentMark, plan: FlatteningPlan
) -> MeasuredSegment | None:
    """Extract a segment of the record on its own clock, with the planned positions at each time."""
    inside = (motion.times >= mark.begin) & (motion.times <= mark.end)
    inside[1:] &= np.diff(motion.times) > 0.0
    if np.count_nonzero(inside) < 2:
        return None
    times = motion.times[inside] - mark.begin
    reference = motion.reference[inside]
    own = np.ones(len(times), dtype=bool)
    for segment in plan.segments:
        if segment.name == mark.name:
            times -= _delay(times, motion.measured[inside], segment.trajectory)
            own = times >= 0.0  # earlier the robot rested at the end of the preceding segment
            since = np.clip(times, 0.0, segment.trajectory.duration)
            reference = segment.trajectory.interpolant()(since)
    if np.count_nonzero(own) < 2:
        return None
    return MeasuredSegment(
        mark.name,
        times[own],
        motion.measured[inside][own],
        motion.velocities[inside][own],
        reference[own],
        motion.openings[inside][own],
    )


def _delay(times: Array, measured: Array, trajectory: Trajectory) -> float:
    """Return the delay from the command to the start of the motion (servo power, pauses), s.

    It compares the last time before the robot moved with that of the plan; what remains is the lag.
    """
    planned = trajectory.interpolant()(np.linspace(0.0, trajectory.duration, _FINE))
    moved = np.abs(measured - measured[0]).max(axis=1) > _MOVED
    should = np.abs(planned - planned[0]).max(axis=1) > _MOVED
    if not moved.any() or not should.any():
        return 0.0
    last = times[max(int(moved.argmax()) - 1, 0)]
    return max(0.0, float(last) - trajectory.duration * int(should.argmax()) / (_FINE - 1))
