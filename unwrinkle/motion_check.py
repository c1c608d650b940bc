"""How well a recorded motion kept to its plan."""

import numpy as np

from unwrinkle.models.robot import Cell
from unwrinkle.planning.execution import ExecutionCheck, MeasuredSegment, check_execution
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.run_records import MotionRecord, SegmentMark


def check_motion(motion: MotionRecord, plan: FlatteningPlan, cell: Cell) -> ExecutionCheck | None:
    """Compare a recorded motion with the plan that it carried out, or with its approach and the way back.

    Returns:
        None where nothing was recorded.
    """
    parts = [_measured(motion, mark, plan) for mark in motion.segments]
    measured = [part for part in parts if part is not None]
    return check_execution(plan, cell, measured) if measured else None


def _measured(
    motion: MotionRecord, mark: SegmentMark, plan: FlatteningPlan
) -> MeasuredSegment | None:
    """A part of the record on its own clock, beside what the plan wants at each time."""
    inside = (motion.times >= mark.begin) & (motion.times <= mark.end)
    inside[1:] &= np.diff(motion.times) > 0.0
    if np.count_nonzero(inside) < 2:
        return None
    times = motion.times[inside] - mark.begin
    reference = motion.reference[inside]
    for segment in plan.segments:
        if segment.name == mark.name:
            since = np.clip(times, 0.0, segment.trajectory.duration)
            reference = segment.trajectory.interpolant()(since)
    return MeasuredSegment(
        mark.name,
        times,
        motion.measured[inside],
        motion.velocities[inside],
        reference,
        motion.openings[inside],
    )
