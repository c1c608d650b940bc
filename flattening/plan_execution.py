"""Execution of a confirmed plan.

Its segments and gripper strokes in order, and the retreat from a missed grasp.
"""

import logging
from dataclasses import replace

import numpy as np

from unwrinkle.flattening.retreat import retreat
from unwrinkle.flattening.state import (
    Feedback,
    Mode,
    Step,
    StepRecord,
    SupervisorSettings,
    SupervisorState,
)
from unwrinkle.flattening.station_messages import GripperCommand, TrajectoryCommand
from unwrinkle.flattening.transitions import at_rest, entered, fault
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan

#: What the strokes are called, in the order of a plan's events.
STROKES = ("close", "open")

_log = logging.getLogger(__name__)


def steps_of(plan: FlatteningPlan) -> tuple[Step, ...]:
    """Return the segments and strokes of a plan in order: approach, close, pull, open, release."""
    steps: list[Step] = []
    for index, segment in enumerate(plan.segments):
        steps.append(Step(segment.name, Mode.MOVE, segment.trajectory))
        if index < len(plan.events):
            event = plan.events[index]
            steps.append(Step(STROKES[index], Mode.GRIP, closed=event.closed, dwell=event.dwell))
    return tuple(steps)


class Execution:
    """The part of the state machine that moves arms and grippers."""

    def __init__(self, settings: SupervisorSettings) -> None:
        """Keep deadlines and tolerances."""
        self._settings = settings

    def begin(
        self, now: SupervisorState, feedback: Feedback, plan: FlatteningPlan
    ) -> SupervisorState:
        """Enter the first step of a confirmed plan."""
        now = replace(now, steps=steps_of(plan))
        return entered(now, now.steps[0].mode, feedback)

    def next(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Return the supervisor_state one period on; in `look` once there is nothing more to do."""
        if now.mode == Mode.GRIP:
            return self._grip(now, feedback)
        return self._move(now, feedback) if now.sent else self._start(now, feedback)

    def _start(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Send a segment as soon as the arms rest at its start."""
        step = now.steps[0]
        assert step.trajectory is not None
        apart = np.abs(feedback.positions() - step.trajectory.positions[0])
        if at_rest(feedback, self._settings) and apart.max() <= self._settings.start:
            number = now.trajectory.number + 1
            command = TrajectoryCommand(number, step.trajectory, step.name)
            return replace(now, trajectory=command, sent=True, since=feedback.time)
        if feedback.time - now.since <= self._settings.rest:
            return now
        axis = int(np.argmax(apart))
        return fault(
            now,
            f"{step.name} was not sent: axis {axis} is {apart[axis]:.5f} rad off its start, at "
            f"most {self._settings.start:g} are allowed, or the arms did not come to rest within "
            f"{self._settings.rest:g} s",
            feedback,
        )

    def _move(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        step, number = now.steps[0], now.trajectory.number
        assert step.trajectory is not None
        status = feedback.controller()
        waited = feedback.time - now.since
        if status.state == MotionMode.FAULT:
            reason = status.reason or "it gives no reason"
            return fault(now, f"{step.name}: the controller is in fault: {reason}", feedback)
        if status.completed == number:
            return self._done(_held_on(now, feedback), number, feedback)
        if status.command != number:
            if waited <= self._settings.answer:
                return now
            return fault(
                now,
                f"{step.name}: the controller did not answer within {self._settings.answer:g} s",
                feedback,
            )
        if status.state != MotionMode.RUNNING:
            verb = "holds" if status.state == MotionMode.HOLDING else "refused the motion"
            reason = status.reason or "it gives no reason"
            return fault(now, f"{step.name}: the controller {verb}: {reason}", feedback)
        most = self._settings.motion * step.trajectory.duration / self._settings.speed
        if waited > most + self._settings.answer:
            return fault(
                now,
                f"{step.name}: not finished after {waited:.1f} s, planned were "
                f"{step.trajectory.duration:.1f} s",
                feedback,
            )
        return now

    def _grip(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        step = now.steps[0]
        if not now.sent:
            command = GripperCommand(now.gripper.number + 1, step.closed)
            return replace(now, gripper=command, sent=True, since=feedback.time)
        status = feedback.grippers()
        waited = feedback.time - now.since
        if status.command != now.gripper.number:
            if not status.reason and waited <= self._settings.gripper:
                return now
            reason = status.reason or f"not finished after {waited:.1f} s"
            return fault(now, f"the grippers did not {step.name}: {reason}", feedback)
        if waited < step.dwell:
            return now
        if status.closed != step.closed:
            return fault(
                now, f"the grippers report {step.name} as done, but are {status.closed}", feedback
            )
        empty = [
            name
            for name, closed, holding in zip(
                ("right", "left"), step.closed, status.holding, strict=True
            )
            if closed and not holding
        ]
        if empty:
            return self._missed(now, empty, feedback)
        return self._done(now, now.gripper.number, feedback)

    def _missed(
        self, now: SupervisorState, empty: list[str], feedback: Feedback
    ) -> SupervisorState:
        """Open the grippers and retreat along the approach."""
        planned = now.action.planned
        assert planned is not None and planned.result is not None
        plan = planned.result.plan
        assert plan is not None
        reason = f"the {' and the '.join(empty)} gripper closed on nothing"
        _log.warning(reason)
        stroke = now.steps[0]
        back = (
            stroke,
            Step("open", Mode.GRIP, closed=(False, False), dwell=stroke.dwell),
            Step("retreat", Mode.RETREAT, retreat(plan.segments[0])),
        )
        action = replace(now.action, outcome="missed", reason=reason)
        now = replace(now, steps=back, action=action)
        return self._done(now, now.gripper.number, feedback)

    def _done(self, now: SupervisorState, number: int, feedback: Feedback) -> SupervisorState:
        """Record the step and enter the next one."""
        step, *rest = now.steps
        record = StepRecord(step.name, number, now.since, feedback.time)
        action = replace(now.action, steps=(*now.action.steps, record))
        now = replace(now, steps=tuple(rest), action=action)
        return entered(now, rest[0].mode if rest else Mode.LOOK, feedback)


def _held_on(now: SupervisorState, feedback: Feedback) -> SupervisorState:
    """Mark the action as missed if a closed gripper has lost its cloth during the segment."""
    status = feedback.grippers()
    lost = [
        name
        for name, closed, holding in zip(
            ("right", "left"), status.closed, status.holding, strict=True
        )
        if closed and not holding
    ]
    if not lost or now.action.outcome:
        return now
    reason = f"the {' and the '.join(lost)} gripper lost the cloth during the {now.steps[0].name}"
    _log.warning(reason)
    return replace(now, action=replace(now.action, outcome="missed", reason=reason))
