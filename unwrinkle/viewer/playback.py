"""Where the robot is at a time of a plan: arms and turn-table from the samples, grippers by their speed."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan


@dataclass(frozen=True)
class Step:
    """A moment with a name: a pose, or a gripper event.

    Attributes:
        name: of the pose, or what the grippers do.
        time: on the plan's clock, s.
        pose: whether it is one of the seven poses.
    """

    name: str
    time: float
    pose: bool


class Playback:
    """A plan as a function of time, between the controller's cubics and the grippers' strokes."""

    def __init__(self, plan: FlatteningPlan, cell: Cell) -> None:
        """Take the segments and events of a plan; gripper stroke and speed from the cell."""
        self._segments = plan.segments
        self._events = plan.events
        self._starts = [segment.start for segment in plan.segments]
        self._cubics = [segment.trajectory.interpolant() for segment in plan.segments]
        self._opening = float(cell.scenario.gripper.opening)
        self._speed = float(cell.limits.gripper.velocity)
        ends = [segment.end for segment in plan.segments]
        self.duration = max(ends + [event.time + event.dwell for event in plan.events])
        steps = [
            Step(mark.name, segment.start + mark.time, True)
            for segment in plan.segments
            for mark in segment.poses
        ]
        closed = plan.segments[0].closed
        for event in plan.events:
            what = [c for c, before in zip(event.closed, closed, strict=True) if c != before]
            if what:
                name = "close grippers" if what[0] else "open grippers"
                steps.append(Step(name if len(what) == 2 else name[:-1], event.time, False))
            closed = event.closed
        self.steps = tuple(sorted(steps, key=lambda step: (step.time, not step.pose)))

    def positions(self, time: float) -> Array:
        """(13,) axis positions in rad; at rest before, between and after the segments."""
        k = max(0, bisect_right(self._starts, time) - 1)
        cubic = self._cubics[k]
        local = min(max(time - self._starts[k], 0.0), float(cubic.x[-1]))
        return np.asarray(cubic(local), dtype=float)

    def openings(self, time: float) -> Array:
        """(2,) distance between the blades of the right and the left gripper, m."""
        opening = np.array(
            [0.0 if closed else self._opening for closed in self._segments[0].closed], dtype=float
        )
        for event in self._events:
            goal = np.array([0.0 if closed else self._opening for closed in event.closed])
            # Until the next event the blades move at their own speed and then stand.
            way = self._speed * min(max(time - event.time, 0.0), event.dwell)
            opening = opening + np.clip(goal - opening, -way, way)
        return opening

    def frame_times(self, rate: float, most: int) -> Array:
        """Times from 0 to the end at an even rate (1/s), or at fewer than that so that there are at most `most`."""
        count = int(np.ceil(self.duration * rate)) + 1
        return np.linspace(0.0, self.duration, min(max(count, 2), most))
