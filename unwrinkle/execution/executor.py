"""Run a plan through a driver and its grippers: segments and gripper events in order.

All axes stop together.

The caller calls `poll` some tens of times per second; no method waits or reads a clock. Every fault
ends in a hold, after which nothing moves without a command: grippers that missed or do not answer
are opened at rest, and the execution ends.
"""

from dataclasses import dataclass

import numpy as np

from unwrinkle.execution._steps import RunningGripperEvent, RunningSegment, Stopping
from unwrinkle.execution.ports import ExecutionDriver, ExecutionGrippers
from unwrinkle.hardware.controller_state import (
    FAULT,
    HELD,
    HOLDING,
    OFFLINE,
    READY,
    RUNNING,
    STARTING,
    DriverStatus,
)
from unwrinkle.hardware.run_log.protocol import NoLog, RunLogger
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.planning.plan import FlatteningPlan, GripperEvent, Segment

DONE = "done"
STOPPED = "stopped"
FAILED = "failed"
ARMS = ("right", "left")
#: Time without a press after which the dead-man key counts as released, s: keyboards start to
#: repeat after about 0.5 s.
DEAD_MAN_TIMEOUT_S = 0.7
#: Maximum time for the driver to accept or refuse a command, s.
ACKNOWLEDGE_TIMEOUT_S = 2.0
#: Maximum time for a stop to come to rest, s.
STOP_TIMEOUT_S = 10.0
#: Maximum time for the grippers to open after a fault, s.
GRIPPER_OPEN_TIMEOUT_S = 4.0
#: Time after which a driver at rest has received a stop, s.
STOP_ACKNOWLEDGE_TIME_S = 0.1
#: Maximum time for a robot whose driver is in fault to come to rest, s; also the age of feedback
#: beyond which the robot's motion is unknown.
SETTLE_TIMEOUT_S = 2.0
#: Speed below which an axis is at rest, rad/s.
REST_SPEED_RAD_S = 5e-3
#: Tolerance of each axis for being at a point, rad.
POSITION_TOLERANCE_RAD = 2e-3
#: Reason of a hold by the dead-man key.
DEAD_MAN_RELEASED = "dead-man key released"


@dataclass(frozen=True)
class ExecutionResult:
    """Result of an execution.

    Attributes:
        outcome: done, stopped (by the operator, a signal, a closed page) or failed.
        reason: why it was stopped or failed; empty if it is done.
        finished: names of the segments that were run to their end.
    """

    outcome: str
    reason: str
    finished: tuple[str, ...]


def _order(step: Segment | GripperEvent) -> tuple[int, int]:
    """Return the sort key of a step.

    An event follows the segment that ends at its time, to the millisecond.
    """
    if isinstance(step, Segment):
        return round(1e3 * step.end), 0
    return round(1e3 * step.time), 1


class PlanExecutor:
    """Execute one plan once.

    Attributes:
        result: how it ended; None while it is running.
        speed: last commanded share of the planned speed.
        held: why it is held; empty if it is not.
    """

    def __init__(
        self,
        driver: ExecutionDriver,
        grippers: ExecutionGrippers | None,
        plan: FlatteningPlan,
        *,
        speed: float = 1.0,
        most_speed: float = 1.0,
        dead_man: bool = False,
        log: RunLogger | None = None,
    ) -> None:
        """Prepare the execution; nothing is sent before the first `poll`.

        Args:
            driver: driver of the controller, ready.
            grippers: driver of the grippers; None turns gripper events into pauses.
            plan: plan that has passed its preflight.
            speed: share of the planned speed.
            most_speed: maximum to which the speed may be raised.
            dead_man: whether motion requires repeated calls of `alive`.
            log: run log of the events.

        Raises:
            InputError: the speed is not above 0, or above `most_speed`.
        """
        self._driver, self._grippers, self._plan = driver, grippers, plan
        self._log: RunLogger = NoLog() if log is None else log
        self._most = most_speed
        self._check(speed)
        self.speed = speed
        self.held = ""
        self._held_by_dead_man = False
        self.result: ExecutionResult | None = None
        self._dead_man = dead_man
        self._alive_at: float | None = None
        steps: list[Segment | GripperEvent] = [*plan.segments, *plan.events]
        self._steps = sorted(steps, key=_order)
        self._next = 0
        self._now = 0.0
        self._log_lost = False
        self._number = driver.status.command
        self._grip_number = 0
        self._running: RunningSegment | None = None
        self._gripping: RunningGripperEvent | None = None
        self._ending: Stopping | None = None
        self._closed = plan.segments[0].closed
        self._finished: list[str] = []
        driver.set_override(speed)

    @property
    def step(self) -> str:
        """Return the current activity in a few words."""
        if self.result is not None:
            return self.result.outcome
        if self._ending is not None:
            return "coming to rest"
        if self._gripping is not None:
            return "closing grippers" if any(self._gripping.event.closed) else "opening grippers"
        return self._running.segment.name if self._running is not None else "waiting"

    @property
    def progress(self) -> float:
        """Return the time on the plan's clock, s."""
        if self._running is not None:
            length = self._running.segment.trajectory.duration
            return self._running.segment.start + min(self._driver.status.progress, length)
        done = self._steps[: self._next]
        return max((s.end if isinstance(s, Segment) else s.time for s in done), default=0.0)

    def hold(self, reason: str = "held by the operator") -> None:
        """Brake along the path and stay at rest until `resume`."""
        if self.held or self._ending is not None or self.result is not None:
            return
        self.held = reason
        self._note("hold", reason)
        if self._running is not None:
            self._driver.hold(self._count())

    def resume(self) -> None:
        """Resume after a hold."""
        if not self.held or self._ending is not None or self.result is not None:
            return
        self._note("resume", f"after: {self.held}")
        self.held = ""
        self._held_by_dead_man = False
        if self._running is not None:
            self._running.asked, self._running.number = self._now, self._count()
            self._driver.resume(self._running.number)

    def stop(self, reason: str = "stopped by the operator") -> None:
        """End the execution: brake along the path and leave trajectory mode.

        The grippers stay as they are.
        """
        self._end(STOPPED, reason)

    def set_speed(self, speed: float) -> None:
        """Set another share of the planned speed.

        Raises:
            InputError: it is not above 0, or above the maximum of this execution; the speed is
                unchanged.
        """
        self._check(speed)
        self.speed = speed
        self._note("speed", f"{speed:g} of the planned speed")
        self._driver.set_override(speed)

    def alive(self, now: float) -> None:
        """Record that the dead-man key is pressed at a time, s."""
        self._alive_at = now

    def poll(self, now: float) -> None:
        """Read the driver and the grippers, and advance the execution.

        Args:
            now: time of any monotonic clock, s.
        """
        self._now = now
        if self.result is not None:
            return
        if self._grippers is not None:
            self._grippers.poll(now)
        status = self._driver.status
        if self._ending is not None:
            self._come_to_rest(status)
        elif status.state in (FAULT, OFFLINE):
            self._end(FAILED, status.reason or f"the driver is {status.state}")
        else:
            self._watch(status)
            if self._ending is None:
                self._go_on(status)

    def _go_on(self, status: DriverStatus) -> None:
        if self._running is not None:
            self._follow(self._running, status)
        elif self._gripping is not None:
            self._grip(self._gripping)
        if self._running is None and self._gripping is None and not self.held:
            self._begin_next()

    def _begin_next(self) -> None:
        if self._next == len(self._steps):
            self._end(DONE, "")
            return
        step = self._steps[self._next]
        if isinstance(step, GripperEvent):
            self._gripping = self._command_grippers(step)
        elif not self._dead_man or self._pressed():
            number = self._count()
            self._note("segment", step.name, number=number)
            if self._ending is not None:
                return
            self._running = RunningSegment(step, number, number, self._now)
            self._driver.run(number, step.trajectory, step.name)

    def _follow(self, move: RunningSegment, status: DriverStatus) -> None:
        if status.command < move.number:
            if self._now - move.asked > ACKNOWLEDGE_TIMEOUT_S:
                self._end(
                    FAILED,
                    f"the driver did not accept {move.segment.name} within "
                    f"{ACKNOWLEDGE_TIMEOUT_S:g} s",
                )
            return
        if status.state in (HOLDING, HELD) and not self.held:
            # The driver holds by itself, e.g. because feedback is late, or a hold cannot be
            # resumed.
            self.held = status.reason or "held by the driver"
            self._note("hold", self.held)
        move.started |= status.state in (STARTING, RUNNING, HOLDING, HELD)
        if status.state != READY or self.held:
            return
        path = move.segment.trajectory.positions
        if self._at(path[-1]) and status.completed >= move.begun:
            self._finished.append(move.segment.name)
            self._running, self._next = None, self._next + 1
        elif self._at(path[0]) and status.completed >= move.begun:
            self._running = None  # held before its start: it is started again
        elif move.started or status.reason:
            reason = status.reason or "the motion ended away from its last point"
            self._end(FAILED, f"{move.segment.name}: {reason}")

    def _at(self, positions: Array) -> bool:
        """Return whether the robot is at a point (13,), rad."""
        feedback = self._driver.feedback
        if feedback is None:
            return False
        return bool(np.abs(feedback.positions - positions).max() <= POSITION_TOLERANCE_RAD)

    def _watch(self, status: DriverStatus) -> None:
        """Hold when the dead-man key is released; end when the grippers lose the cloth."""
        if self._dead_man:
            if not self._pressed() and self._running is not None and not self.held:
                self.hold(DEAD_MAN_RELEASED)
                self._held_by_dead_man = True
            elif self._pressed() and self._held_by_dead_man and status.state == HELD:
                self.resume()
        if self._running is None or self._grippers is None or not any(self._closed):
            return
        lost = self._missed(self._closed)
        if self._grippers.status.reason:
            self._end(FAILED, self._grippers.status.reason, open_grippers=True)
        elif lost:
            self._end(FAILED, f"the {lost} gripper lost the cloth", open_grippers=True)

    def _command_grippers(self, event: GripperEvent) -> RunningGripperEvent:
        what = " and ".join(
            f"{arm} {'closes' if closed else 'opens'}"
            for arm, closed, before in zip(ARMS, event.closed, self._closed, strict=True)
            if closed != before
        )
        self._grip_number += 1
        number, closed = self._grip_number, list(event.closed)
        self._note("gripper", what, number=number, closed=closed)
        if self._grippers is not None and self._ending is None:
            self._grippers.command(self._grip_number, event.closed)
        return RunningGripperEvent(event, self._grip_number, self._now)

    def _grip(self, grip: RunningGripperEvent) -> None:
        if self._now - grip.asked < grip.event.dwell:
            return
        if self._grippers is not None:
            report = self._grippers.status
            if report.reason:
                self._end(FAILED, report.reason, open_grippers=True)
                return
            if report.command < grip.number:
                return
            missed = self._missed(grip.event.closed)
            if missed:
                text = f"the {missed} gripper closed without cloth: the grasp missed"
                self._end(FAILED, text, open_grippers=True)
                return
        self._closed = grip.event.closed
        self._gripping, self._next = None, self._next + 1

    def _missed(self, closed: tuple[bool, bool]) -> str:
        """Return the closed grippers of participating arms that report no cloth.

        The text is empty if there are none.
        """
        assert self._grippers is not None
        holding = self._grippers.status.holding
        missed = [
            name
            for name, arm, shut, held in zip(ARMS, self._plan.arms, closed, holding, strict=True)
            if arm is not None and shut and held is False
        ]
        return " and the ".join(missed)

    def _end(self, outcome: str, reason: str, *, open_grippers: bool = False) -> None:
        if self.result is not None:
            return
        if self._ending is not None:
            # The first reason is kept; a completed motion that is interrupted at its end is not
            # done.
            if self._ending.outcome != DONE:
                return
            open_grippers = self._ending.open_grippers
        self._note("end", reason or outcome, outcome=outcome)
        self._ending = Stopping(outcome, reason, self._now, open_grippers)
        self._driver.stop(reason or "the plan is done")

    def _come_to_rest(self, status: DriverStatus) -> None:
        ending = self._ending
        assert ending is not None
        waited = self._now - ending.asked
        if status.state in (FAULT, OFFLINE):
            # The execution follows the robot to rest, so that the log is complete.
            if waited < SETTLE_TIMEOUT_S and not self._at_rest(status):
                return
            if ending.outcome == DONE:
                self._finish(FAILED, status.reason or f"the driver is {status.state}")
                return
        elif status.state != READY:
            if waited > STOP_TIMEOUT_S:
                self._finish(
                    FAILED,
                    f"{ending.reason}; the robot did not come to rest within {STOP_TIMEOUT_S:g} s",
                )
            return
        elif waited < STOP_ACKNOWLEDGE_TIME_S:
            return
        if ending.open_grippers and self._grippers is not None:
            if ending.opened is None:
                self._grip_number += 1
                self._note("gripper", "both open", closed=[False, False])
                self._grippers.command(self._grip_number, (False, False))
                ending.opened = self._now
            elif self._grippers.status.command >= self._grip_number:
                self._finish(
                    ending.outcome, f"{ending.reason}; both grippers are open, the arms are at rest"
                )
            elif self._now - ending.opened > GRIPPER_OPEN_TIMEOUT_S:
                self._finish(
                    ending.outcome,
                    f"{ending.reason}; the grippers did not open, the arms are at rest",
                )
            return
        self._finish(ending.outcome, ending.reason)

    def _finish(self, outcome: str, reason: str) -> None:
        self.result = ExecutionResult(outcome, reason, tuple(self._finished))
        self._note("result", reason or outcome, outcome=outcome)

    def _pressed(self) -> bool:
        return self._alive_at is not None and self._now - self._alive_at <= DEAD_MAN_TIMEOUT_S

    def _at_rest(self, status: DriverStatus) -> bool:
        """Return whether the robot is at rest, or its motion is unknown."""
        feedback = self._driver.feedback
        if feedback is None or status.state == OFFLINE or status.feedback_age > SETTLE_TIMEOUT_S:
            return True
        return bool(np.abs(feedback.velocities).max() <= REST_SPEED_RAD_S)

    def _note(self, kind: str, text: str, **data: object) -> None:
        """Write an event; end the execution, without delay, if the log cannot be written."""
        try:
            self._log.event(self._now, kind, text, **data)
        except OSError as error:
            if not self._log_lost:
                self._log_lost = True
                self._end(FAILED, f"the run log cannot be written: {error}")

    def _count(self) -> int:
        self._number += 1
        return self._number

    def _check(self, speed: float) -> None:
        if not 0.0 < speed <= 1.0:
            raise InputError(f"the speed is {speed:g}; give a fraction above 0, up to 1")
        if speed > self._most + 1e-9:
            raise InputError(
                f"the speed is {speed:g}, above the {self._most:g} that this execution allows"
            )
