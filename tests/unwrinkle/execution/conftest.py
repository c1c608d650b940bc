"""A driver and grippers without a robot, and an executor on a fake clock around them."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.hardware.controller_state import (
    FAULT,
    HELD,
    READY,
    RUNNING,
    STARTING,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.hardware.grippers.base import GripperReport
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.trajectory import Trajectory

PLAY = RobotStatus(1, 0, 0, 0, 0, 2, 1)
STEP = 0.02


class FakeDriver:
    """Fake driver that runs exactly and without delay, and holds and stops within one step."""

    def __init__(self, positions: np.ndarray) -> None:
        self.status = DriverStatus(READY, robot=PLAY, feedback_age=0.0)
        self.feedback: JointFeedback | None = JointFeedback(positions, np.zeros(13), 0.0)
        self.calls: list[tuple[object, ...]] = []
        self.refuses = ""
        self.deaf = False
        self._trajectory: Trajectory | None = None
        self._number = 0
        self._override = 1.0

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        self.calls.append(("run", number, name))
        if self.deaf:
            return
        if self.refuses:
            self._set(command=number, reason=self.refuses)
            return
        self._trajectory, self._number = trajectory, number
        self._set(state=STARTING, command=number, progress=0.0, reason="")

    def hold(self, number: int) -> None:
        self.calls.append(("hold", number))
        if self.status.state == STARTING:
            self._trajectory = None
        held = HELD if self._trajectory is not None else READY
        self._set(state=held, command=number, completed=number)

    def resume(self, number: int) -> None:
        self.calls.append(("resume", number))
        if self.status.state != HELD or self.refuses:
            reason = self.refuses or "there is nothing to resume"
            self._set(command=number, reason=f"resume refused: {reason}")
            return
        self._number = number
        self._set(state=RUNNING, command=number, reason="")

    def stop(self, reason: str) -> None:
        self.calls.append(("stop", reason))
        self._trajectory = None
        if self.status.state != FAULT:
            self._set(state=READY, progress=0.0, reason="")

    def set_override(self, value: float) -> None:
        self.calls.append(("override", value))
        self._override = value

    def fail(self, reason: str) -> None:
        self._trajectory = None
        self._set(state=FAULT, reason=reason)

    def advance(self) -> None:
        """Advance by one step of the clock."""
        if self._trajectory is None or self.status.state not in (STARTING, RUNNING):
            return
        progress = self.status.progress + STEP * self._override
        if progress < self._trajectory.duration:
            self._set(state=RUNNING, progress=progress)
            return
        positions = self._trajectory.positions[-1]
        self.feedback = JointFeedback(positions, np.zeros(13), 0.0)
        self._trajectory = None
        self._set(state=READY, completed=self._number, progress=0.0)

    @property
    def runs(self) -> list[object]:
        """Return the names of the executed segments."""
        return [call[2] for call in self.calls if call[0] == "run"]

    def _set(self, **changes: object) -> None:
        self.status = dc.replace(self.status, **changes)


class FakeGrippers:
    """Fake grippers that finish shortly after a command."""

    def __init__(self) -> None:
        self.status = GripperReport()
        self.commands: list[tuple[bool, bool]] = []
        self.holding: tuple[bool | None, bool | None] = (True, True)
        self.lost = ""
        self._asked: tuple[int, tuple[bool, bool], float] | None = None
        self._now = 0.0

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        self.commands.append(closed)
        self._asked = (number, closed, self._now)
        self.status = dc.replace(self.status, reason="")

    def poll(self, now: float) -> None:
        self._now = now
        if self._asked is None:
            return
        number, closed, when = self._asked
        if self.lost and any(closed):
            if now - when > 3.0:
                self.status = dc.replace(self.status, reason=self.lost)
            return
        if now - when > 0.5:
            holding = self.holding if any(closed) else (False, False)
            self.status = GripperReport(number, None, closed, holding)


class Bench:
    """Executor with its fakes and clock."""

    def __init__(self, plan: FlatteningPlan, *, grippers: bool = True, **options: object) -> None:
        self.plan = plan
        self.driver = FakeDriver(plan.segments[0].trajectory.positions[0])
        self.grippers = FakeGrippers()
        settings = ExecutionSettings().for_single_run(attended=True, most_speed=0.5)
        options = {"speed": 0.5, **options}
        self.executor = PlanExecutor(
            self.driver, self.grippers if grippers else None, plan, settings, **options
        )
        self.now = 0.0

    def run(self, until: Callable[[], bool] = lambda: False, most: float = 60.0) -> None:
        """Advance until a condition or the end; fail if neither is reached."""
        end = self.now + most
        while self.executor.result is None and not until():
            assert self.now < end, f"no end: {self.executor.step}"
            self.step()

    def step(self) -> None:
        self.executor.poll(self.now)
        self.driver.advance()
        self.now += STEP

    def during(self, name: str) -> Callable[[], bool]:
        """Return whether a segment is running and has moved."""
        return lambda: self.executor.step == name and self.driver.status.progress > 0.2


@pytest.fixture
def bench_of(plan: FlatteningPlan) -> Callable[..., Bench]:
    """Return a function that makes a bench; its options are passed to the executor."""

    def make(**options: object) -> Bench:
        return Bench(plan, **options)

    return make


@pytest.fixture
def bench(bench_of: Callable[..., Bench]) -> Bench:
    return bench_of()
