"""Runs a plan through a driver and its grippers: segments and gripper events in order, one fate for all.

Whoever runs it calls `poll` some tens of times a second; nothing here waits or reads a clock. Whatever goes wrong ends in a
hold, and nothing moves by itself after it: a gripper that missed or does not answer is opened at rest, and that is all.
"""

from dataclasses import dataclass

import numpy as np

from unwrinkle.execution._steps import Ending, Grip, Move
from unwrinkle.execution.ports import Driver, Grippers
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

DONE, STOPPED, FAILED = "done", "stopped", "failed"
ARMS = ("right", "left")
#: A dead-man key counts as released after this, s: keyboards begin to repeat after some 0.5 s.
DEAD_MAN = 0.7
#: s in which a driver takes or refuses a command.
TAKEN = 2.0
#: s in which a stop comes to rest, and in which the grippers open after a fault.
AT_REST, OPENED = 10.0, 4.0
#: s in which a driver that rests has seen a stop, and in which a robot whose driver is in fault comes to rest.
TAKES_STOP, SETTLED = 0.1, 2.0
#: An axis slower than this stands, rad/s.
STANDS = 5e-3
#: An axis within this of a point stands there, rad.
AT = 2e-3


@dataclass(frozen=True)
class ExecutionResult:
    """How an execution ended.

    Attributes:
        outcome: done, stopped (by the operator, a signal, a closed page) or failed.
        reason: why, where it is not done.
        finished: names of the segments that were run to their end.
    """

    outcome: str
    reason: str
    finished: tuple[str, ...]


def _place(step: Segment | GripperEvent) -> tuple[int, int]:
    """Where a step stands: an event follows the segment that ends when it comes, to the millisecond."""
    if isinstance(step, Segment):
        return round(1e3 * step.end), 0
    return round(1e3 * step.time), 1


class PlanExecutor:
    """One execution of one plan.

    Attributes:
        result: how it ended; None while it goes on.
        speed: share of the planned speed that was asked for last.
        held: why it holds; empty while it goes on.
    """

    def __init__(
        self,
        driver: Driver,
        grippers: Grippers | None,
        plan: FlatteningPlan,
        *,
        speed: float = 1.0,
        most_speed: float = 1.0,
        dead_man: bool = False,
        log: RunLogger | None = None,
    ) -> None:
        """Prepare; nothing is sent before the first `poll`.

        Args:
            driver: of the controller, ready.
            grippers: None: gripper events are pauses.
            plan: that passed its preflight.
            speed: share of the planned speed.
            most_speed: what the speed may be raised to.
            dead_man: whether motion goes on only while `alive` is called.
            log: takes what happens.

        Raises:
            InputError: the speed is not above 0, up to `most_speed`.
        """
        self._driver, self._grippers, self._plan = driver, grippers, plan
        self._log: RunLogger = NoLog() if log is None else log
        self._most = most_speed
        self._check(speed)
        self.speed = speed
        self.held = ""
        self.result: ExecutionResult | None = None
        self._dead_man = dead_man
        self._alive_at: float | None = None
        steps: list[Segment | GripperEvent] = [*plan.segments, *plan.events]
        self._steps = sorted(steps, key=_place)
        self._next = 0
        self._now = 0.0
        self._log_lost = False
        self._number = driver.status.command
        self._grip_number = 0
        self._running: Move | None = None
        self._gripping: Grip | None = None
        self._ending: Ending | None = None
        self._closed = plan.segments[0].closed
        self._finished: list[str] = []
        driver.set_override(speed)

    @property
    def step(self) -> str:
        """What it does now, in a few words."""
        if self.result is not None:
            return self.result.outcome
        if self._ending is not None:
            return "coming to rest"
        if self._gripping is not None:
            return "closing grippers" if any(self._gripping.event.closed) else "opening grippers"
        return self._running.segment.name if self._running is not None else "waiting"

    @property
    def progress(self) -> float:
        """Place on the plan's clock, s."""
        if self._running is not None:
            length = self._running.segment.trajectory.duration
            return self._running.segment.start + min(self._driver.status.progress, length)
        done = self._steps[: self._next]
        return max((s.end if isinstance(s, Segment) else s.time for s in done), default=0.0)

    def hold(self, reason: str = "held by the operator") -> None:
        """Brake along the path, and stay until `resume`."""
        if self.held or self._ending is not None or self.result is not None:
            return
        self.held = reason
        self._note("hold", reason)
        if self._running is not None:
            self._driver.hold(self._count())

    def resume(self) -> None:
        """Go on after a hold."""
        if not self.held or self._ending is not None or self.result is not None:
            return
        self._note("resume", f"after: {self.held}")
        self.held = ""
        if self._running is not None:
            self._running.asked, self._running.number = self._now, self._count()
            self._driver.resume(self._running.number)

    def stop(self, reason: str = "stopped by the operator") -> None:
        """End it: brake along the path, and leave trajectory mode; the grippers stay as they are."""
        self._end(STOPPED, reason)

    def set_speed(self, speed: float) -> None:
        """Ask for another share of the planned speed.

        Raises:
            InputError: it is not above 0, or more than this execution may use; the speed stays as it is.
        """
        self._check(speed)
        self.speed = speed
        self._note("speed", f"{speed:g} of the planned speed")
        self._driver.set_override(speed)

    def alive(self, now: float) -> None:
        """The dead-man key is pressed at this time, s."""
        self._alive_at = now

    def poll(self, now: float) -> None:
        """Look at driver and grippers, and go on as far as they are.

        Args:
            now: any monotonic clock, s.
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
            self._running = Move(step, number, number, self._now)
            self._driver.run(number, step.trajectory, step.name)

    def _follow(self, move: Move, status: DriverStatus) -> None:
        if status.command < move.number:
            if self._now - move.asked > TAKEN:
                self._end(FAILED, f"the driver did not take {move.segment.name} in {TAKEN:g} s")
            return
        if status.state in (HOLDING, HELD) and not self.held:
            # Its own doing, as for old feedback; or what was held cannot be resumed.
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
            self._running = None  # held before it had begun: it is begun anew
        elif move.started or status.reason:
            reason = status.reason or "it ended away from its last point"
            self._end(FAILED, f"{move.segment.name}: {reason}")

    def _at(self, positions: Array) -> bool:
        """Whether the robot stands there."""
        feedback = self._driver.feedback
        return feedback is not None and bool(np.abs(feedback.positions - positions).max() <= AT)

    def _watch(self, status: DriverStatus) -> None:
        """The dead-man key, and cloth that slips while it is pulled."""
        if self._dead_man:
            released = "dead-man key released"
            if not self._pressed() and self._running is not None and not self.held:
                self.hold(released)
            elif self._pressed() and self.held == released and status.state == HELD:
                self.resume()
        if self._running is None or self._grippers is None or not any(self._closed):
            return
        lost = self._missed(self._closed)
        if self._grippers.status.reason:
            self._end(FAILED, self._grippers.status.reason, open_grippers=True)
        elif lost:
            self._end(FAILED, f"the {lost} gripper lost the cloth", open_grippers=True)

    def _command_grippers(self, event: GripperEvent) -> Grip:
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
        return Grip(event, self._grip_number, self._now)

    def _grip(self, grip: Grip) -> None:
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
                text = f"the {missed} gripper closed on nothing: the grasp missed"
                self._end(FAILED, text, open_grippers=True)
                return
        self._closed = grip.event.closed
        self._gripping, self._next = None, self._next + 1

    def _missed(self, closed: tuple[bool, bool]) -> str:
        """Which gripper of an arm that takes part holds nothing though it is closed; empty if none is known to."""
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
            # The first reason stays; a done motion that is broken off in its last moment is not.
            if self._ending.outcome != DONE:
                return
            open_grippers = self._ending.open_grippers
        self._note("end", reason or outcome, outcome=outcome)
        self._ending = Ending(outcome, reason, self._now, open_grippers)
        self._driver.stop(reason or "the plan is done")

    def _come_to_rest(self, status: DriverStatus) -> None:
        ending = self._ending
        assert ending is not None
        waited = self._now - ending.asked
        if status.state in (FAULT, OFFLINE):
            # Whatever stops it now, the log follows it to rest.
            if waited < SETTLED and not self._stands(status):
                return
            if ending.outcome == DONE:
                self._finish(FAILED, status.reason or f"the driver is {status.state}")
                return
        elif status.state != READY:
            if waited > AT_REST:
                self._finish(FAILED, f"{ending.reason}; the robot did not come to rest")
            return
        elif waited < TAKES_STOP:
            return
        if ending.open_grippers and self._grippers is not None:
            if ending.opened is None:
                self._grip_number += 1
                self._note("gripper", "both open", closed=[False, False])
                self._grippers.command(self._grip_number, (False, False))
                ending.opened = self._now
            elif self._grippers.status.command >= self._grip_number:
                self._finish(
                    ending.outcome, f"{ending.reason}; both grippers are open, the arms rest"
                )
            elif self._now - ending.opened > OPENED:
                self._finish(
                    ending.outcome, f"{ending.reason}; the grippers did not open, the arms rest"
                )
            return
        self._finish(ending.outcome, ending.reason)

    def _finish(self, outcome: str, reason: str) -> None:
        self.result = ExecutionResult(outcome, reason, tuple(self._finished))
        self._note("result", reason or outcome, outcome=outcome)

    def _pressed(self) -> bool:
        return self._alive_at is not None and self._now - self._alive_at <= DEAD_MAN

    def _stands(self, status: DriverStatus) -> bool:
        """Whether the robot rests, or nothing is known of it any more."""
        feedback = self._driver.feedback
        if feedback is None or status.state == OFFLINE or status.feedback_age > SETTLED:
            return True
        return bool(np.abs(feedback.velocities).max() <= STANDS)

    def _note(self, kind: str, text: str, **data: object) -> None:
        """Write an event; a log that cannot be written ends the execution, and never keeps it from stopping."""
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
            raise InputError(f"speed is {speed:g}; give a fraction above 0, up to 1")
        if speed > self._most + 1e-9:
            raise InputError(
                f"speed is {speed:g}, more than the {self._most:g} that this execution may use"
            )
