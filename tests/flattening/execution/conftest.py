"""A small plan, and the executor around a model robot on plain values."""

import dataclasses as dc
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.flattening.execution.state import (
    ExecutionFeedback,
    ExecutionState,
    MotionCommand,
    MotionKind,
    OperatorWishes,
)
from unwrinkle.flattening.station_messages import ControllerStatus, GripperCommand, GripperStatus
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan, GripperEvent, Segment
from unwrinkle.planning.trajectory import Trajectory

HOME = np.linspace(-0.3, 0.4, 13)
PERIOD = 0.025


def trajectory(first: float, last: float) -> Trajectory:
    share = np.linspace(0.0, 1.0, 6)[:, None]
    smooth, slope = 3 * share**2 - 2 * share**3, 6 * share * (1 - share) / 0.5
    positions = HOME + first + (last - first) * smooth * np.ones(13)
    return Trajectory(0.5 * share[:, 0], positions, (last - first) * slope * np.ones(13))


def small_plan() -> FlatteningPlan:
    """Return a plan with the attributes that an execution uses."""
    moves = {"approach": (0.0, 0.2), "pull": (0.2, 0.3), "release": (0.3, 0.0)}
    segments = tuple(
        Segment(name, 0.0, trajectory(*ends), (name == "pull",) * 2, (), (0.0, 0.0))
        for name, ends in moves.items()
    )
    events = (GripperEvent(0.0, (True, True), 0.2), GripperEvent(0.0, (False, False), 0.2))
    plan: Any = SimpleNamespace(segments=segments, events=events, arms=(object(), object()))
    return plan  # type: ignore[no-any-return]


class ModelRobot:
    """Robot that follows commands ideally; its attributes inject faults."""

    def __init__(self) -> None:
        self.status = ControllerStatus()
        self.grip = GripperStatus()
        self.positions, self.velocities = HOME.copy(), np.zeros(13)
        self.age = 0.0
        self.refuses = ""
        self.deaf = self.hangs = False
        self.jaws_deaf: frozenset[int] = frozenset()
        self.holding: tuple[bool, bool] = (True, True)
        self.motions: list[MotionCommand] = []
        self.strokes: list[tuple[bool, bool]] = []
        self._moving: Trajectory | None = None

    def feedback(self, time: float, *, grippers: bool = True) -> ExecutionFeedback:
        grip = self.grip if grippers else None
        return ExecutionFeedback(time, self.positions, self.velocities, self.status, grip, self.age)

    def take(self, motion: MotionCommand, stroke: GripperCommand) -> None:
        """Take the commands that are new."""
        if motion.number > (self.motions[-1].number if self.motions else 0):
            self.motions.append(motion)
            if not self.deaf:
                self._take(motion)
        if stroke.number > self.grip.command and stroke.number not in self.jaws_deaf:
            self.strokes.append(stroke.closed)
            right, left = (c and h for c, h in zip(stroke.closed, self.holding, strict=True))
            self.grip = GripperStatus(stroke.number, (0.0, 0.0), stroke.closed, (right, left))

    def _take(self, motion: MotionCommand) -> None:
        reason = self.status.reason if self.status.state == MotionMode.FAULT else ""
        self.set(command=motion.number, reason=reason)
        if motion.kind == MotionKind.RUN:
            if self.refuses:
                self.set(reason=self.refuses)
                return
            self._moving = motion.trajectory
            self.set(state=MotionMode.RUNNING, progress=0.0)
        elif motion.kind == MotionKind.RESUME:
            if self.refuses or self._moving is None:
                self.set(reason=self.refuses or "there is nothing to resume")
                return
            self.set(state=MotionMode.RUNNING)
        elif self.status.state != MotionMode.FAULT:
            self.velocities = np.zeros(13)
            if motion.kind == MotionKind.STOP or self.status.progress == 0.0:
                self._moving = None
            held = self._moving is not None
            state = MotionMode.HELD if held else MotionMode.IDLE
            self.set(state=state, completed=motion.number)

    def advance(self) -> None:
        """Advance by one period."""
        if self._moving is None or self.status.state != MotionMode.RUNNING or self.hangs:
            return
        progress, duration = self.status.progress + PERIOD, self._moving.duration
        motion = self._moving.interpolant()
        self.positions, self.velocities = motion(min(progress, duration)), motion(progress, 1)
        self.set(progress=progress)
        if progress >= duration:
            self._moving, self.velocities = None, np.zeros(13)
            self.set(state=MotionMode.IDLE, completed=self.status.command, progress=0.0)

    def set(self, **changes: object) -> None:
        self.status = dc.replace(self.status, **changes)

    def fail(self, reason: str) -> None:
        self._moving, self.velocities = None, np.zeros(13)
        self.set(state=MotionMode.FAULT, reason=reason)

    @property
    def runs(self) -> list[str]:
        """Names of the motions that were commanded."""
        return [motion.name for motion in self.motions if motion.kind == MotionKind.RUN]

    @property
    def kinds(self) -> list[str]:
        return [motion.kind for motion in self.motions]


class ModelRun:
    """One execution with the model robot."""

    def __init__(self, settings: ExecutionSettings, *, grippers: bool = True) -> None:
        self.settings = settings
        self.robot = ModelRobot()
        self.plan = small_plan()
        self.grippers = grippers
        self.time = 0.0
        self.state = executor.begin(ExecutionState(), self.plan, 0.0)
        self.states = [self.state]

    def step(self, **wishes: Any) -> ExecutionState:
        """Step once, pass the commands on, and advance the robot."""
        self.time += PERIOD
        feedback = self.robot.feedback(self.time, grippers=self.grippers)
        self.state = executor.step(self.settings, self.state, feedback, OperatorWishes(**wishes))
        self.states.append(self.state)
        self.robot.take(self.state.motion, self.state.gripper)
        self.robot.advance()
        return self.state

    def steps(self, count: int, **wishes: Any) -> ExecutionState:
        for _ in range(count):
            self.step(**wishes)
        return self.state

    def until(self, over: Callable[[], bool] = lambda: False, **wishes: Any) -> ExecutionState:
        """Step until a condition or the end."""
        count = 0
        while self.state.result is None and not over():
            count += 1
            assert count < 2000, f"no end: {self.state.activity}"
            self.step(**wishes)
        return self.state

    def during(self, name: str) -> Callable[[], bool]:
        """Return whether a segment is running and has moved."""
        return lambda: self.state.activity == name and self.robot.status.progress > 0.1

    @property
    def events(self) -> list[str]:
        return [event.kind for state in self.states for event in state.events]


@pytest.fixture
def run_of() -> Callable[..., ModelRun]:
    """Return a function that makes an execution with settings."""
    return ModelRun


@pytest.fixture
def looped(run_of: Callable[..., ModelRun]) -> ModelRun:
    """Return an execution as the closed loop makes it."""
    return run_of(ExecutionSettings())


@pytest.fixture
def attended(run_of: Callable[..., ModelRun]) -> ModelRun:
    """Return an execution as `unwrinkle execute` makes it."""
    return run_of(ExecutionSettings().for_single_run(attended=True, most_speed=0.5))


@pytest.fixture
def with_key(run_of: Callable[..., ModelRun]) -> ModelRun:
    """Return an execution under commissioning."""
    return run_of(ExecutionSettings().for_single_run(attended=True, dead_man=True))
