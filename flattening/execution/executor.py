"""Execute a plan: segments and gripper strokes in order, all axes on one clock.

The executor is a function of values: it reads no clock and sends nothing. The caller steps it some
tens of times per second with the robot's feedback, and passes the commands of the new state on. A
segment or a stroke is commanded only while the arms are at rest, a segment only from its start.

A grasp that closes on nothing is followed by the retreat along the verified approach. Every fault
ends in a stop: the arms brake along the path and come to rest, and nothing moves after that.
"""

import logging
from dataclasses import replace
from typing import Any

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
from unwrinkle.flattening.execution.steps import Step, StepRecord, steps_back, steps_of
from unwrinkle.flattening.station_messages import GripperCommand
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.trajectory import Trajectory

ARMS = ("right", "left")
#: Reason of a hold by the dead-man key.
DEAD_MAN_RELEASED = "dead-man key released"
_NO_REASON = "it gives no reason"
_NO_WISHES = OperatorWishes()

_log = logging.getLogger(__name__)


def begin(before: ExecutionState, plan: FlatteningPlan, time: float) -> ExecutionState:
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
    settings: ExecutionSettings,
    before: ExecutionState,
    feedback: ExecutionFeedback,
    wishes: OperatorWishes = _NO_WISHES,
) -> ExecutionState:
    """Return the next state of an execution; the same object where nothing has changed.

    Args:
        settings: tolerances, deadlines and reactions.
        before: present state.
        feedback: newest feedback.
        wishes: of the operator, since the last step.

    Raises:
        InputError: the speed is not permitted.
    """
    if not before.running:
        return before
    return _Transition(settings, before, feedback).following(wishes)


class _Transition:
    """One step: `now` begins as the present state and ends as the next one."""

    def __init__(
        self, settings: ExecutionSettings, before: ExecutionState, feedback: ExecutionFeedback
    ) -> None:
        self.now = replace(before, events=()) if before.events else before
        self._settings, self._feedback, self._time = settings, feedback, feedback.time
        self._status, self._grippers = feedback.controller, feedback.grippers
        self._rests = settings.at_rest(feedback)

    def following(self, wishes: OperatorWishes) -> ExecutionState:
        """Return the next state."""
        self._grant(wishes)
        if self.now.ending is None and self._status.state == MotionMode.FAULT:
            self._fail(f"the controller is in fault: {self._status.reason or _NO_REASON}")
        {
            Phase.WAITING: self._wait,
            Phase.MOVING: self._move,
            Phase.GRIPPING: self._grip,
            Phase.STOPPING: self._come_to_rest,
            Phase.OPENING: self._open,
        }[self.now.phase]()
        return self.now

    @property
    def _step(self) -> Step:
        return self.now.steps[0]

    def _set(self, **changes: Any) -> None:
        self.now = replace(self.now, **changes)

    def _note(self, kind: str, text: str, **data: object) -> None:
        """Add an event for the log."""
        self._set(events=(*self.now.events, ExecutionEvent(kind, text, data)))

    # Wishes

    def _grant(self, wishes: OperatorWishes) -> None:
        if wishes.alive:
            self._set(alive_at=self._time)
        if wishes.speed is not None:
            self._settings.check_speed(wishes.speed)
            self._set(speed=wishes.speed, allowed_from=self._time)
            self._note("speed", f"{wishes.speed:g} of the planned speed")
        if wishes.fail:
            self._end(Outcome.FAILED, wishes.fail)
        elif wishes.stop:
            self._end(Outcome.STOPPED, wishes.stop)
        elif self.now.ending is None and wishes.hold:
            self._hold(wishes.hold)
        elif wishes.resume and self.now.held:
            self._resume()

    def _hold(self, reason: str, *, released: bool = False) -> None:
        if self.now.held:
            if self.now.released:  # the operator's hold outlasts a press of the dead-man key
                self._set(held=reason, released=False)
            return
        self._set(held=reason, released=released)
        self._note("hold", reason)
        if self.now.phase == Phase.MOVING:
            self._command(MotionKind.HOLD)

    def _resume(self) -> None:
        self._note("resume", f"after: {self.now.held}")
        self._set(held="", released=False)
        if self.now.phase == Phase.MOVING:
            self._command(MotionKind.RESUME)
            self._set(allowed_from=self._time)
        elif self.now.phase == Phase.WAITING:
            self._set(since=self._time)

    def _pressed(self) -> bool:
        return self._time - self.now.alive_at <= self._settings.dead_man_timeout

    # Steps of the plan

    def _wait(self) -> None:
        """Command a step once the arms are at rest, a segment from its start."""
        if self.now.held:
            return
        trajectory = self._step.trajectory
        if trajectory is not None and self._settings.dead_man and not self._pressed():
            self._set(since=self._time)
            return
        there = trajectory is None or self._settings.at(self._feedback, trajectory.positions[0])
        if not there or not self._rests:
            if self._time - self.now.since > self._settings.rest:
                self._not_sent(None if there else trajectory)
        elif trajectory is not None:
            self._command(MotionKind.RUN, trajectory)
            self._set(phase=Phase.MOVING, begun=self.now.motion.number)
            self._set(since=self._time, allowed_from=self._time)
        else:
            strokes = [
                f"{arm} {'closes' if closed else 'opens'}"
                for arm, closed, before in zip(
                    ARMS, self._step.closed, self.now.closed, strict=True
                )
                if closed != before
            ]
            self._stroke(self._step.closed, " and ".join(strokes), Phase.GRIPPING)

    def _not_sent(self, trajectory: Trajectory | None) -> None:
        """Fail away from the start of a trajectory, or because the arms move."""
        why = "the arms did not come to rest"
        if trajectory is not None:
            off = np.abs(self._feedback.positions - trajectory.positions[0])
            tolerance = np.broadcast_to(self._settings.position_tolerance, off.shape)
            axis = int(np.argmax(off - tolerance))
            why = f"axis {axis} is {off[axis]:.5f} rad off its start, at most {tolerance[axis]:g}"
        self._fail(f"it was not sent: {why}")

    def _move(self) -> None:
        status, settings = self._status, self._settings
        if trouble := self._gripper_trouble():
            self._fail(trouble, open_grippers=True)
        elif settings.dead_man and not self.now.held and not self._pressed():
            self._hold(DEAD_MAN_RELEASED, released=True)
        elif status.command < self.now.motion.number:
            if self._time - self.now.asked > settings.answer:
                self._fail(f"the controller did not answer within {settings.answer:g} s")
        elif self.now.held:
            resting = status.state in (MotionMode.HELD, MotionMode.IDLE)
            if self.now.released and resting and self._pressed():
                self._resume()
        elif status.state in (MotionMode.HOLDING, MotionMode.HELD):
            reason = status.reason or _NO_REASON
            if settings.attended:
                self._set(held=reason)
                self._note("hold", reason)
            else:
                self._fail(f"the controller holds: {reason}")
        elif status.state == MotionMode.IDLE:
            self._motion_ended()
        else:
            self._overdue()

    def _gripper_trouble(self) -> str:
        """Return why the grippers end a segment in which they are closed; empty if they do not."""
        if self._grippers is None or not any(self._step.closed):
            return ""
        lost = self._empty()
        if lost and not self._grippers.reason and self._settings.lost_cloth == LostCloth.STOP:
            return f"the {lost} gripper lost the cloth"
        return self._grippers.reason

    def _motion_ended(self) -> None:
        """Go on from a motion that the controller reports as completed, held or refused."""
        status, trajectory = self._status, self._step.trajectory
        assert trajectory is not None
        if status.completed < self.now.begun:
            self._fail(f"the controller refused the motion: {status.reason or _NO_REASON}")
        elif self._settings.at(self._feedback, trajectory.positions[-1]):
            if (lost := self._empty()) and not self.now.missed:
                self._miss(f"the {lost} gripper lost the cloth during the {self._step.name}")
            self._done(self.now.begun)
        elif self.now.motion.number > self.now.begun and self._settings.at(
            self._feedback, trajectory.positions[0]
        ):
            self._set(phase=Phase.WAITING, since=self._time)  # it was held before it began
        else:
            self._fail(status.reason or "the motion ended away from its last point")

    def _overdue(self) -> None:
        trajectory, settings = self._step.trajectory, self._settings
        assert trajectory is not None
        waited, planned = self._time - self.now.allowed_from, trajectory.duration
        most = settings.motion * planned / self.now.speed + settings.start_delay + settings.answer
        if waited > most:
            self._fail(f"not finished after {waited:.1f} s, planned were {planned:.1f} s")

    def _grip(self) -> None:
        waited, status, name = self._time - self.now.since, self._grippers, self._step.name
        if status is not None and status.command < self.now.gripper.number:
            if status.reason or waited > self._settings.gripper:
                reason = status.reason or f"not finished after {waited:.1f} s"
                text = f"the grippers did not {name}: {reason}"
                self._fail(text, open_grippers=True, named=False)
        elif waited >= self._step.dwell:
            if status is not None and status.closed != self._step.closed:
                text = f"the grippers report {name} as done, but are {status.closed}"
                self._fail(text, open_grippers=True, named=False)
                return
            empty = self._empty()
            self._done(self.now.gripper.number)
            if empty:
                self._miss(f"the {empty} gripper closed on nothing")
                self._set(steps=self.now.back)

    def _empty(self) -> str:
        """Return the closed grippers of participating arms that report no cloth; empty for none."""
        if self._grippers is None:
            return ""
        columns = (ARMS, self.now.arms, self._step.closed, self._grippers.holding)
        return " and the ".join(
            name
            for name, arm, closed, holds in zip(*columns, strict=True)
            if arm and closed and not holds
        )

    def _miss(self, reason: str) -> None:
        _log.warning(reason)
        self._set(missed=reason)

    def _done(self, number: int) -> None:
        """Record the present step, and wait for the next one or end."""
        now, rest = self.now, self.now.steps[1:]
        record = StepRecord(self._step.name, number, now.since, self._time)
        records, closed = (*now.records, record), self._step.closed
        self._set(records=records, closed=closed, phase=Phase.WAITING, since=self._time, steps=rest)
        if not rest:
            self._end(Outcome.MISSED if now.missed else Outcome.DONE, now.missed)

    # The end

    def _fail(self, reason: str, *, open_grippers: bool = False, named: bool = True) -> None:
        """Stop and end as failed."""
        text = f"{self._step.name}: {reason}" if named else reason
        text = f"{self.now.missed}; {text}" if self.now.missed else text
        self._end(Outcome.FAILED, text, open_grippers=open_grippers)

    def _end(self, outcome: Outcome, reason: str, *, open_grippers: bool = False) -> None:
        """Come to rest, then end; the first reason is kept, unless the plan was done."""
        now = self.now
        if now.ending is not None:
            if now.ending.outcome == Outcome.DONE:
                self._note("end", reason, outcome=outcome)
                self._set(ending=Ending(outcome, reason))
            return
        self._note("end", reason or outcome, outcome=outcome)
        self._set(ending=Ending(outcome, reason, open_grippers), held="", released=False)
        if outcome in (Outcome.DONE, Outcome.MISSED) and not self._settings.leave_mode:
            self._finish(outcome, reason)
            return
        if now.phase == Phase.MOVING or self._settings.leave_mode:
            self._command(MotionKind.STOP, reason=reason or "the plan is done")
        self._set(phase=Phase.STOPPING, since=self._time)

    def _come_to_rest(self) -> None:
        ending, status, settings = self.now.ending, self._status, self._settings
        assert ending is not None
        waited = self._time - self.now.since
        if status.state == MotionMode.FAULT:
            # The execution follows the robot to rest, so that the log is complete.
            known = self._feedback.age <= settings.settle
            if waited < settings.settle and known and not self._rests:
                return
            if ending.outcome in (Outcome.DONE, Outcome.MISSED):
                reason = status.reason or "the controller is in fault"
                text = f"{ending.reason}; {reason}" if ending.reason else reason
                self._finish(Outcome.FAILED, text)
                return
        else:
            answered = status.command >= self.now.motion.number or waited > settings.answer
            if not (answered and self._rests and status.state == MotionMode.IDLE):
                if waited > settings.brake:
                    text = f"the robot did not come to rest within {settings.brake:g} s"
                    self._finish(Outcome.FAILED, f"{ending.reason}; {text}")
                return
        if not ending.open_grippers or self._grippers is None:
            self._finish(ending.outcome, ending.reason)
        elif self._rests:
            self._stroke((False, False), "both open", Phase.OPENING)
        else:
            text = "the grippers were not opened: it is not known that the arms are at rest"
            self._finish(ending.outcome, f"{ending.reason}; {text}")

    def _open(self) -> None:
        """Wait until the grippers are open, then end."""
        ending = self.now.ending
        assert ending is not None and self._grippers is not None
        opened = self._grippers.command >= self.now.gripper.number
        if opened or self._time - self.now.since > self._settings.gripper:
            what = "both grippers are open" if opened else "the grippers did not open"
            self._finish(ending.outcome, f"{ending.reason}; {what}, the arms are at rest")

    def _finish(self, outcome: Outcome, reason: str) -> None:
        self._note("result", reason or outcome, outcome=outcome)
        result = ExecutionResult(outcome, reason, self.now.finished)
        self._set(phase=Phase.IDLE, steps=(), result=result)

    # Commands

    def _command(
        self, kind: MotionKind, trajectory: Trajectory | None = None, *, reason: str = ""
    ) -> None:
        name = self._step.name if self.now.steps else ""
        number = self.now.motion.number + 1
        if kind == MotionKind.RUN:
            self._note("segment", name, number=number)
        motion = MotionCommand(number, kind, name, trajectory, reason)
        self._set(motion=motion, asked=self._time)

    def _stroke(self, closed: tuple[bool, bool], text: str, phase: Phase) -> None:
        number = self.now.gripper.number + 1
        self._note("gripper", text, number=number, closed=list(closed))
        self._set(gripper=GripperCommand(number, closed), phase=phase, since=self._time)
