"""Posture of the robot at a time of a plan.

Arms and turn-table follow from the samples, grippers from their speed.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan


@dataclass(frozen=True)
class PlaybackStep:
    """Named moment of a plan: a pose or a gripper event.

    Attributes:
        name: name of the pose, or action of the grippers.
        time: time on the plan's clock, s.
        pose: whether it is one of the seven poses.
    """

    name: str
    time: float
    pose: bool


class Playback:
    """Plan as a function of time: the controller's cubics, the grippers' speed."""

    def __init__(self, plan: FlatteningPlan, cell: Cell) -> None:
        """Keep a plan's segments and events, and the cell's gripper stroke and speed."""
        self._segments = plan.segments
        self._events = plan.events
        self._starts = [segment.start for segment in plan.segments]
        self._cubics = [segment.trajectory.interpolant() for segment in plan.segments]
        self._opening = float(cell.scenario.gripper.opening)
        self._speed = float(cell.limits.gripper.velocity)
        ends = [segment.end for segment in plan.segments]
        self.duration = max(ends + [event.time + event.dwell for event in plan.events])
        steps = [
            PlaybackStep(mark.name, segment.start + mark.time, True)
            for segment in plan.segments
            for mark in segment.poses
        ]
        closed = plan.segments[0].closed
        for event in plan.events:
            what = [c for c, before in zip(event.closed, closed, strict=True) if c != before]
            if what:
                name = "close grippers" if what[0] else "open grippers"
                steps.append(PlaybackStep(name if len(what) == 2 else name[:-1], event.time, False))
            closed = event.closed
        self.steps = tuple(sorted(steps, key=lambda step: (step.time, not step.pose)))

    def positions(self, time: float) -> Array:
        """Return the axis positions (13,), rad; at rest before, between and after the segments."""
        k = max(0, bisect_right(self._starts, time) - 1)
        cubic = self._cubics[k]
        local = min(max(time - self._starts[k], 0.0), float(cubic.x[-1]))
        return np.asarray(cubic(local), dtype=float)

    def openings(self, time: float) -> Array:
        """Return the openings of the right and the left gripper (2,), m."""
        opening = np.array(
            [0.0 if closed else self._opening for closed in self._segments[0].closed], dtype=float
        )
        for event in self._events:
            goal = np.array([0.0 if closed else self._opening for closed in event.closed])
            # Until the next event the blades move at their speed, then rest.
            way = self._speed * min(max(time - event.time, 0.0), event.dwell)
            opening = opening + np.clip(goal - opening, -way, way)
        return opening

    def frame_times(self, rate: float, most: int) -> Array:
        """Return times from 0 to the end at a rate (1/s), at most `most` times."""
        count = int(np.ceil(self.duration * rate)) + 1
        return np.linspace(0.0, self.duration, min(max(count, 2), most))
