"""Step the executor of plans with the devices of a site.

Status, feedback and gripper report become the executor's feedback, its commands go to the devices,
its events to the run log.
"""

from dataclasses import replace

import numpy as np

from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.flattening.execution.state import (
    ExecutionFeedback,
    ExecutionResult,
    ExecutionState,
    MotionCommand,
    MotionKind,
    OperatorWishes,
    Phase,
)
from unwrinkle.flattening.station_messages import ControllerStatus, GripperCommand, GripperStatus
from unwrinkle.hardware.controller.base import Driver
from unwrinkle.hardware.controller_state import MOTION_MODES, DriverState
from unwrinkle.hardware.grippers.base import Grippers
from unwrinkle.hardware.run_log.protocol import NoLog, RunLogger
from unwrinkle.planning.plan import FlatteningPlan


class PlanExecutor:
    """Execute one plan once with a driver and grippers.

    The caller calls `poll` some tens of times per second; no method waits or reads a clock. Wishes
    take effect in the next poll.

    Attributes:
        state: of the executor.
    """

    def __init__(
        self,
        driver: Driver,
        grippers: Grippers | None,
        plan: FlatteningPlan,
        settings: ExecutionSettings,
        *,
        speed: float = 1.0,
        stroke: int = 0,
        log: RunLogger | None = None,
    ) -> None:
        """Set the speed; nothing moves before the first `poll`.

        Args:
            driver: driver of the controller, ready.
            grippers: driver of the grippers; None turns gripper events into pauses.
            plan: plan that has passed its preflight.
            settings: tolerances, deadlines and reactions.
            speed: share of the planned speed.
            stroke: number of the last command to the grippers.
            log: run log of the events.

        Raises:
            InputError: the speed is not permitted, or the plan's approach cannot be run backwards.
        """
        settings.check_speed(speed)
        self._driver, self._grippers, self._plan = driver, grippers, plan
        self._settings = settings
        self._log: RunLogger = NoLog() if log is None else log
        self._log_lost = False
        self._wishes = OperatorWishes()
        self._polled = False
        numbers = ExecutionState(
            motion=MotionCommand(driver.status.command),
            gripper=GripperCommand(stroke),
            speed=speed,
        )
        self.state = executor.begin(numbers, plan, 0.0)
        driver.set_override(speed)

    @property
    def result(self) -> ExecutionResult | None:
        """How it ended; None while it is running."""
        return self.state.result

    @property
    def held(self) -> str:
        """Why it is held; empty if it is not."""
        return self.state.held

    @property
    def speed(self) -> float:
        """Share of the planned speed, the newest wish included."""
        return self.state.speed if self._wishes.speed is None else self._wishes.speed

    @property
    def step(self) -> str:
        """Present activity in a few words."""
        return self.state.activity

    @property
    def progress(self) -> float:
        """Time on the plan's clock, s."""
        segments = {segment.name: segment for segment in self._plan.segments}
        if self.state.phase == Phase.MOVING and (now := segments.get(self.state.steps[0].name)):
            return now.start + min(self._driver.status.progress, now.trajectory.duration)
        ends = (segments[name].end for name in self.state.finished if name in segments)
        return max(ends, default=0.0)

    def hold(self, reason: str = "held by the operator") -> None:
        """Brake along the path and stay at rest until `resume`."""
        self._wishes = replace(self._wishes, hold=self._wishes.hold or reason, resume=False)

    def resume(self) -> None:
        """Resume after a hold."""
        self._wishes = replace(self._wishes, hold="", resume=True)

    def stop(self, reason: str = "stopped by the operator") -> None:
        """End the execution: brake along the path and leave trajectory mode.

        The grippers stay as they are.
        """
        self._wishes = replace(self._wishes, stop=self._wishes.stop or reason)

    def set_speed(self, speed: float) -> None:
        """Set another share of the planned speed.

        Raises:
            InputError: it is not permitted; the speed is unchanged.
        """
        self._settings.check_speed(speed)
        self._wishes = replace(self._wishes, speed=speed)

    def alive(self) -> None:
        """Record that the dead-man key was pressed."""
        self._wishes = replace(self._wishes, alive=True)

    def poll(self, now: float) -> None:
        """Read the driver and the grippers, step the executor, and command the devices.

        Args:
            now: time of any monotonic clock, s.
        """
        if self.result is not None:
            return
        if self._grippers is not None:
            self._grippers.poll(now)
        if not self._polled:
            self._polled, self.state = True, replace(self.state, since=now)
        before, feedback, wishes = self.state, self._feedback(now), self._wishes
        self._wishes = OperatorWishes()
        following = executor.step(self._settings, before, feedback, wishes)
        if problem := self._written(now, following):
            wishes = replace(wishes, fail=problem)
            following = executor.step(self._settings, before, feedback, wishes)
            self._written(now, following)
        self.state = following
        self._send(before, following)

    def _feedback(self, now: float) -> ExecutionFeedback:
        status = self._driver.status
        feedback = self._driver.feedback
        axes = self._plan.segments[0].trajectory.positions.shape[1]
        unknown = np.full(axes, np.nan)
        return ExecutionFeedback(
            now,
            unknown if feedback is None else feedback.positions,
            unknown if feedback is None else feedback.velocities,
            ControllerStatus(
                MOTION_MODES[status.state],
                status.command,
                status.completed,
                status.progress,
                status.reason or (status.state if status.state == DriverState.OFFLINE else ""),
            ),
            self._gripper_status(),
            float("inf") if feedback is None else status.feedback_age,
        )

    def _gripper_status(self) -> GripperStatus | None:
        if self._grippers is None:
            return None
        report = self._grippers.status
        # A closed gripper without a sensor is assumed to hold cloth.
        right, left = (
            closed if holds is None else holds
            for closed, holds in zip(report.closed, report.holding, strict=True)
        )
        return GripperStatus(
            report.command, (0.0, 0.0), report.closed, (right, left), report.reason
        )

    def _written(self, now: float, state: ExecutionState) -> str:
        """Write the events; return why the log cannot be written, the first time."""
        for event in state.events:
            try:
                self._log.event(now, event.kind, event.text, **event.data)
            except OSError as error:
                if not self._log_lost:
                    self._log_lost = True
                    return f"the run log cannot be written: {error}"
        return ""

    def _send(self, before: ExecutionState, now: ExecutionState) -> None:
        driver, motion, stroke = self._driver, now.motion, now.gripper
        if now.speed != before.speed:
            driver.set_override(now.speed)
        if motion.number > before.motion.number:
            if motion.trajectory is not None:
                driver.run(motion.number, motion.trajectory, motion.name)
            elif motion.kind == MotionKind.RESUME:
                driver.resume(motion.number)
            else:
                if motion.kind == MotionKind.STOP:
                    driver.stop(motion.reason)
                driver.hold(motion.number)  # after a stop, it only acknowledges the number
        if stroke.number > before.gripper.number and self._grippers is not None:
            self._grippers.command(stroke.number, stroke.closed)
