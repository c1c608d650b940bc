"""Execute a plan: segments and gripper strokes in order, all axes on one clock.

The executor is a function of values: it reads no clock and sends nothing. The caller steps it some
tens of times per second with the robot's feedback, and passes the commands of the new state on. A
segment or a stroke is commanded only while the arms are at rest, a segment only from its start.

A grasp that closes on nothing is followed by the retreat along the verified approach. Every fault
ends in a stop: the arms brake along the path and come to rest, and nothing moves after that.
"""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from unwrinkle.flattening.execution.settings import ExecutionSettings, LostCloth
from unwrinkle.flattening.execution.state import (
    Ending,
    ExecutionEvent,
    ExecutionFeedback,
    ExecutionResult,
    ExecutionState,
    MotionCommand,
    MotionKind,
    OperatorWishes,
    Outcome,
    Phase,
)
from unwrinkle.flattening.execution.steps import StepRecord, steps_back, steps_of
from unwrinkle.flattening.station_messages import GripperCommand
from unwrinkle.models.arrays import Array
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.trajectory import Trajectory

ARMS = ("right", "left")
#: Reason of a hold by the dead-man key.
DEAD_MAN_RELEASED = "dead-man key released"
NO_WISHES = OperatorWishes()

_log = logging.getLogger(__name__)

_Handler = Callable[[ExecutionState, ExecutionFeedback], ExecutionState]


class Executor:
    """The rules by which an `ExecutionState` changes."""

    def __init__(self, settings: ExecutionSettings) -> None:
        """Use tolerances, deadlines and reactions."""
        self.settings = settings
        self._phases: dict[Phase, _Handler] = {
            Phase.WAITING: self._wait,
            Phase.MOVING: self._move,
            Phase.GRIPPING: self._grip,
            Phase.STOPPING: self._come_to_rest,
            Phase.OPENING: self._open,
        }

    def begin(self, before: ExecutionState, plan: FlatteningPlan, time: float) -> ExecutionState:
        """Return the state in which a verified plan begins; the first step commands it.

        Args:
            before: last state, whose numbers and speed go on.
            plan: plan that was verified from where the robot is.
            time: of the caller's clock, s.

        Raises:
            InputError: the approach of the plan cannot be run backwards.
        """
        right, left = plan.arms
        return ExecutionState(
            phase=Phase.WAITING,
            steps=steps_of(plan),
            back=steps_back(plan),
            arms=(right is not None, left is not None),
            since=time,
            motion=before.motion,
            gripper=before.gripper,
            speed=before.speed,
            closed=plan.segments[0].closed,
        )

    def step(
        self,
        before: ExecutionState,
        feedback: ExecutionFeedback,
        wishes: OperatorWishes = NO_WISHES,
    ) -> ExecutionState:
        """Return the next state; the same object where nothing has changed.

        Args:
            before: present state.
            feedback: newest feedback.
            wishes: of the operator, since the last step.

        Raises:
            InputError: the speed is not permitted.
        """
        if not before.running:
            return before
        now = replace(before, events=()) if before.events else before
        if wishes is not NO_WISHES:
            now = self._wished(now, feedback, wishes)
        if now.ending is None and feedback.controller.state == MotionMode.FAULT:
            reason = feedback.controller.reason or "it gives no reason"
            now = self._fail(now, feedback, f"the controller is in fault: {reason}")
        return self._phases[now.phase](now, feedback)

    def at_rest(self, feedback: ExecutionFeedback) -> bool:
        """Return whether every axis is known to be at rest."""
        known = feedback.age <= self.settings.settle
        return known and bool(np.abs(feedback.velocities).max() <= self.settings.rest_speed)

    def at(self, feedback: ExecutionFeedback, positions: Array) -> bool:
        """Return whether every axis is at a point (A,), rad."""
        off = np.abs(feedback.positions - positions)
        return bool((off <= self.settings.position_tolerance).all())

    # Wishes

    def _wished(
        self, now: ExecutionState, feedback: ExecutionFeedback, wishes: OperatorWishes
    ) -> ExecutionState:
        if wishes.alive:
            now = replace(now, alive_at=feedback.time)
        if wishes.speed is not None:
            self.settings.check_speed(wishes.speed)
            text = f"{wishes.speed:g} of the planned speed"
            now = replace(now, speed=wishes.speed, allowed_from=feedback.time)
            now = _noted(now, "speed", text)
        if wishes.fail:
            return self._end(now, feedback, Outcome.FAILED, wishes.fail)
        if wishes.stop:
            return self._end(now, feedback, Outcome.STOPPED, wishes.stop)
        if now.ending is None and wishes.hold:
            return self._hold(now, feedback, wishes.hold)
        if now.ending is None and wishes.resume and now.held:
            return self._resume(now, feedback)
        return now

    def _hold(
        self,
        now: ExecutionState,
        feedback: ExecutionFeedback,
        reason: str,
        *,
        released: bool = False,
    ) -> ExecutionState:
        if now.held:
            # The operator's hold outlasts a press of the dead-man key.
            return replace(now, held=reason, released=False) if now.released else now
        now = _noted(replace(now, held=reason, released=released), "hold", reason)
        return self._command(now, feedback, MotionKind.HOLD) if now.phase == Phase.MOVING else now

    def _resume(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        now = _noted(now, "resume", f"after: {now.held}")
        now = replace(now, held="", released=False)
        if now.phase == Phase.MOVING:
            now = replace(now, allowed_from=feedback.time)
            return self._command(now, feedback, MotionKind.RESUME)
        return replace(now, since=feedback.time) if now.phase == Phase.WAITING else now

    def _pressed(self, now: ExecutionState, feedback: ExecutionFeedback) -> bool:
        return feedback.time - now.alive_at <= self.settings.dead_man_timeout

    # Steps of the plan

    def _wait(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        """Command a step once the arms are at rest, a segment from its start."""
        if now.held:
            return now
        step, trajectory = now.steps[0], now.steps[0].trajectory
        if trajectory is not None and self.settings.dead_man and not self._pressed(now, feedback):
            return replace(now, since=feedback.time)
        there = trajectory is None or self.at(feedback, trajectory.positions[0])
        if not there or not self.at_rest(feedback):
            if feedback.time - now.since <= self.settings.rest:
                return now
            why = "the arms did not come to rest"
            if trajectory is not None and not there:
                off = np.abs(feedback.positions - trajectory.positions[0])
                axis = int(np.argmax(off - self.settings.position_tolerance))
                most = np.broadcast_to(self.settings.position_tolerance, off.shape)[axis]
                why = f"axis {axis} is {off[axis]:.5f} rad off its start, at most {most:g} rad"
            return self._fail(now, feedback, f"it was not sent: {why}")
        if trajectory is not None:
            now = self._command(now, feedback, MotionKind.RUN, trajectory)
            return replace(
                now,
                phase=Phase.MOVING,
                begun=now.motion.number,
                since=feedback.time,
                allowed_from=feedback.time,
            )
        strokes = [
            f"{arm} {'closes' if closed else 'opens'}"
            for arm, closed, before in zip(ARMS, step.closed, now.closed, strict=True)
            if closed != before
        ]
        return self._stroke(now, feedback, step.closed, " and ".join(strokes), Phase.GRIPPING)

    def _move(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        if any(now.steps[0].closed) and feedback.grippers is not None:
            lost = self._empty(now, feedback, now.steps[0].closed)
            reason = feedback.grippers.reason
            if not reason and lost and self.settings.lost_cloth == LostCloth.STOP:
                reason = f"the {lost} gripper lost the cloth"
            if reason:
                return self._fail(now, feedback, reason, open_grippers=True)
        if self.settings.dead_man and not now.held and not self._pressed(now, feedback):
            return self._hold(now, feedback, DEAD_MAN_RELEASED, released=True)
        status, settings = feedback.controller, self.settings
        if status.command < now.motion.number:
            if feedback.time - now.asked <= settings.answer:
                return now
            text = f"the controller did not answer within {settings.answer:g} s"
            return self._fail(now, feedback, text)
        if not now.held and status.state in (MotionMode.HOLDING, MotionMode.HELD):
            reason = status.reason or "it gives no reason"
            if not settings.attended:
                return self._fail(now, feedback, f"the controller holds: {reason}")
            return _noted(replace(now, held=reason), "hold", reason)
        if now.held:
            resting = status.state in (MotionMode.HELD, MotionMode.IDLE)
            if now.released and resting and self._pressed(now, feedback):
                return self._resume(now, feedback)
            return now
        if status.state == MotionMode.IDLE:
            return self._motion_ended(now, feedback)
        return self._overdue(now, feedback)

    def _motion_ended(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        """Go on from a motion that the controller reports as completed, held or refused."""
        status, trajectory = feedback.controller, now.steps[0].trajectory
        assert trajectory is not None
        if status.completed < now.begun:
            reason = status.reason or "it gives no reason"
            return self._fail(now, feedback, f"the controller refused the motion: {reason}")
        if self.at(feedback, trajectory.positions[-1]):
            lost = self._empty(now, feedback, now.steps[0].closed)
            if lost and not now.missed:
                text = f"the {lost} gripper lost the cloth during the {now.steps[0].name}"
                _log.warning(text)
                now = replace(now, missed=text)
            return self._done(now, now.begun, feedback)
        if now.motion.number > now.begun and self.at(feedback, trajectory.positions[0]):
            return replace(now, phase=Phase.WAITING, since=feedback.time)  # held before it began
        reason = status.reason or "the motion ended away from its last point"
        return self._fail(now, feedback, reason)

    def _overdue(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        trajectory, settings = now.steps[0].trajectory, self.settings
        assert trajectory is not None
        waited = feedback.time - now.allowed_from
        most = settings.motion * trajectory.duration / now.speed
        if waited <= most + settings.start_delay + settings.answer:
            return now
        text = f"not finished after {waited:.1f} s, planned were {trajectory.duration:.1f} s"
        return self._fail(now, feedback, text)

    def _grip(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        step, waited, status = now.steps[0], feedback.time - now.since, feedback.grippers
        if status is not None and status.command < now.gripper.number:
            if not status.reason and waited <= self.settings.gripper:
                return now
            reason = status.reason or f"not finished after {waited:.1f} s"
            reason = f"the grippers did not {step.name}: {reason}"
            return self._fail(now, feedback, reason, open_grippers=True, named=False)
        if waited < step.dwell:
            return now
        if status is not None and status.closed != step.closed:
            text = f"the grippers report {step.name} as done, but are {status.closed}"
            return self._fail(now, feedback, text, open_grippers=True, named=False)
        empty = self._empty(now, feedback, step.closed)
        now = self._done(now, now.gripper.number, feedback)
        if not empty:
            return now
        text = f"the {empty} gripper closed on nothing"
        _log.warning(text)
        return replace(now, steps=now.back, missed=text)

    def _empty(
        self, now: ExecutionState, feedback: ExecutionFeedback, closed: tuple[bool, bool]
    ) -> str:
        """Return the closed grippers of participating arms that report no cloth; empty for none."""
        if feedback.grippers is None:
            return ""
        held = feedback.grippers.holding
        empty = [
            name
            for name, arm, shut, holds in zip(ARMS, now.arms, closed, held, strict=True)
            if arm and shut and not holds
        ]
        return " and the ".join(empty)

    def _done(
        self, now: ExecutionState, number: int, feedback: ExecutionFeedback
    ) -> ExecutionState:
        """Record the present step, and wait for the next one or end."""
        step, *rest = now.steps
        record = StepRecord(step.name, number, now.since, feedback.time)
        now = replace(
            now,
            steps=tuple(rest),
            records=(*now.records, record),
            closed=step.closed,
            phase=Phase.WAITING,
            since=feedback.time,
        )
        if rest:
            return now
        return self._end(now, feedback, Outcome.MISSED if now.missed else Outcome.DONE, now.missed)

    # The end

    def _fail(
        self,
        now: ExecutionState,
        feedback: ExecutionFeedback,
        reason: str,
        *,
        open_grippers: bool = False,
        named: bool = True,
    ) -> ExecutionState:
        """Stop and end as failed."""
        text = f"{now.steps[0].name}: {reason}" if named else reason
        text = f"{now.missed}; {text}" if now.missed else text
        return self._end(now, feedback, Outcome.FAILED, text, open_grippers=open_grippers)

    def _end(
        self,
        now: ExecutionState,
        feedback: ExecutionFeedback,
        outcome: Outcome,
        reason: str,
        *,
        open_grippers: bool = False,
    ) -> ExecutionState:
        """Come to rest, then end; the first reason is kept, unless the plan was done."""
        if now.ending is not None:
            if now.ending.outcome != Outcome.DONE:
                return now
            now = _noted(now, "end", reason, outcome=outcome)
            return replace(now, ending=Ending(outcome, reason))
        now = _noted(now, "end", reason or outcome, outcome=outcome)
        now = replace(now, ending=Ending(outcome, reason, open_grippers), held="", released=False)
        complete = outcome in (Outcome.DONE, Outcome.MISSED)
        if complete and not self.settings.leave_mode:
            return self._finish(now, outcome, reason)
        if now.phase == Phase.MOVING or self.settings.leave_mode:
            now = self._command(now, feedback, MotionKind.STOP, reason=reason or "the plan is done")
        return replace(now, phase=Phase.STOPPING, since=feedback.time)

    def _come_to_rest(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        ending, status, settings = now.ending, feedback.controller, self.settings
        assert ending is not None
        waited, rests = feedback.time - now.since, self.at_rest(feedback)
        if status.state == MotionMode.FAULT:
            # The execution follows the robot to rest, so that the log is complete.
            known = feedback.age <= settings.settle
            if waited < settings.settle and known and not rests:
                return now
            if ending.outcome in (Outcome.DONE, Outcome.MISSED):
                reason = status.reason or "the controller is in fault"
                text = f"{ending.reason}; {reason}" if ending.reason else reason
                return self._finish(now, Outcome.FAILED, text)
        else:
            answered = status.command >= now.motion.number or waited > settings.answer
            if not (answered and rests and status.state == MotionMode.IDLE):
                if waited <= settings.brake:
                    return now
                text = f"the robot did not come to rest within {settings.brake:g} s"
                return self._finish(now, Outcome.FAILED, f"{ending.reason}; {text}")
        if not ending.open_grippers or feedback.grippers is None:
            return self._finish(now, ending.outcome, ending.reason)
        if not rests:
            text = "the grippers were not opened: it is not known that the arms are at rest"
            return self._finish(now, ending.outcome, f"{ending.reason}; {text}")
        return self._stroke(now, feedback, (False, False), "both open", Phase.OPENING)

    def _open(self, now: ExecutionState, feedback: ExecutionFeedback) -> ExecutionState:
        """Wait until the grippers are open, then end."""
        ending = now.ending
        assert ending is not None and feedback.grippers is not None
        opened = feedback.grippers.command >= now.gripper.number
        if not opened and feedback.time - now.since <= self.settings.gripper:
            return now
        what = "both grippers are open" if opened else "the grippers did not open"
        return self._finish(now, ending.outcome, f"{ending.reason}; {what}, the arms are at rest")

    def _finish(self, now: ExecutionState, outcome: Outcome, reason: str) -> ExecutionState:
        now = _noted(now, "result", reason or outcome, outcome=outcome)
        result = ExecutionResult(outcome, reason, now.finished)
        return replace(now, phase=Phase.IDLE, steps=(), result=result)

    # Commands

    def _command(
        self,
        now: ExecutionState,
        feedback: ExecutionFeedback,
        kind: MotionKind,
        trajectory: Trajectory | None = None,
        *,
        reason: str = "",
    ) -> ExecutionState:
        name = now.steps[0].name if now.steps else ""
        number = now.motion.number + 1
        if kind == MotionKind.RUN:
            now = _noted(now, "segment", name, number=number)
        motion = MotionCommand(number, kind, name, trajectory, reason)
        return replace(now, motion=motion, asked=feedback.time)

    def _stroke(
        self,
        now: ExecutionState,
        feedback: ExecutionFeedback,
        closed: tuple[bool, bool],
        text: str,
        phase: Phase,
    ) -> ExecutionState:
        number = now.gripper.number + 1
        now = _noted(now, "gripper", text, number=number, closed=list(closed))
        command = GripperCommand(number, closed)
        return replace(now, gripper=command, phase=phase, since=feedback.time)


def _noted(now: ExecutionState, kind: str, text: str, **data: object) -> ExecutionState:
    """Add an event for the log."""
    return replace(now, events=(*now.events, ExecutionEvent(kind, text, data)))
