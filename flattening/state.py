"""The supervisor's state as one immutable value, and the feedback that it reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.flattening.execution.state import ExecutionState
from unwrinkle.flattening.execution.steps import Step, StepRecord
from unwrinkle.flattening.flattener import Refusal
from unwrinkle.flattening.messages import Analysed, Perceived, Planned, PlanRequest, Verified
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import PolicyState, PullDecision, Stop
from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.models.site import Site


class Mode(StrEnum):
    """States of the state machine."""

    LOOK = "look"
    PERCEIVE = "perceive"
    DECIDE = "decide"
    PLAN = "plan"
    CONFIRM = "confirm"  # the verdict
    APPROVE = "approve"  # the operator's answer
    MOVE = "move"
    GRIP = "grip"
    RETREAT = "retreat"
    HOLD = "hold"  # comes to rest after an interrupt or a fault of an execution
    DONE = "done"
    FAULT = "fault"


class RunStatus(StrEnum):
    """How a run stands, or how it ended."""

    RUNNING = "running"
    FLAT = "flat"
    STOPPED = "stopped"
    FAULTED = "fault"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class SupervisorSettings:
    """Deadlines on the station's clock, s, and the settings of the executor.

    Attributes:
        look: from a head command to the exposure, which waits for the units and the cloth to rest;
            every attempt of the site's cameras fits in.
        answer: for perception, planning and verification to answer by number; they compute within
            the period in which they are asked.
        replans: greatest number of new plans for one wrinkle because the robot had moved.
        speed: share of the planned speed, 0 to 1.
        execution: tolerances, deadlines and reactions of the executor; also for rest before a look.
    """

    look: float = 30.0
    answer: float = 1.0
    replans: int = 2
    speed: float = 1.0
    execution: ExecutionSettings = field(default_factory=ExecutionSettings)

    @classmethod
    def of_site(cls, site: Site) -> SupervisorSettings:
        """Return deadlines that allow for the timeouts of a site's devices."""
        cameras = site.cameras
        look = cameras.attempts * cameras.timeout + site.pan_tilt.motion_timeout
        return cls(
            look=max(30.0, look + 5.0),
            speed=site.speed,
            execution=ExecutionSettings.of_site(site),
        )


@dataclass(frozen=True, eq=False)
class Action(Shared):
    """One look and what followed; complete once `outcome` is not empty.

    Attributes:
        look: number of the head command.
        began: when, on the station's clock, s.
        perceived: range map of the look.
        analysed: its observation, or the reason why there is none.
        observation: that the policy decided on; None where there is none.
        pull: decision to pull; None where nothing is pulled.
        stop: decision to stop; None where something is pulled.
        refusals: wrinkles before it that could not be pulled.
        planned: the plan.
        verified: its verdict.
        steps: that were executed.
        outcome: done, missed, blind, flat, stopped, fault or interrupted; empty while it goes on.
        reason: for an outcome that is not `done`.
        policy_state: after it.
        ended: when, on the station's clock, s.
    """

    look: int = 0
    began: float = 0.0
    perceived: Perceived | None = None
    analysed: Analysed | None = None
    observation: Observation | None = None
    pull: PullDecision | None = None
    stop: Stop | None = None
    refusals: tuple[Refusal, ...] = ()
    planned: Planned | None = None
    verified: Verified | None = None
    steps: tuple[StepRecord, ...] = ()
    outcome: str = ""
    reason: str = ""
    policy_state: PolicyState = field(default_factory=PolicyState)
    ended: float = 0.0


@dataclass(frozen=True, eq=False)
class SupervisorState(Shared):
    """State of the supervisor.

    Attributes:
        mode: state of the state machine.
        since: when the state, or its command, began on the station's clock, s.
        sent: whether the head's command of a look was sent.
        policy_state: of the policy.
        head, request: last commands.
        execution: state of the executor, with the last commands to the arms and grippers.
        centre: (3,) point of the world to look at next, m.
        replans: new plans for this wrinkle.
        action: the present one.
        finished: the action before; None at first.
        status: running, flat, stopped, fault or interrupted.
        reason: why it ended.
    """

    mode: Mode = Mode.LOOK
    since: float = 0.0
    sent: bool = False
    policy_state: PolicyState = field(default_factory=PolicyState)
    head: HeadCommand = field(default_factory=HeadCommand)
    execution: ExecutionState = field(default_factory=ExecutionState)
    request: PlanRequest = field(default_factory=PlanRequest)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    replans: int = 0
    action: Action = field(default_factory=Action)
    finished: Action | None = None
    status: RunStatus = RunStatus.RUNNING
    reason: str = ""

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self.mode in (Mode.DONE, Mode.FAULT)

    @property
    def steps(self) -> tuple[Step, ...]:
        """Remaining steps of the action, the current one first."""
        return self.execution.steps

    @property
    def trajectory(self) -> TrajectoryCommand:
        """Last command to the arms; a stop is a hold: the controller stays in trajectory mode."""
        motion = self.execution.motion
        if motion.trajectory is None:
            return TrajectoryCommand(motion.number, None, "hold" if motion.number else "")
        return TrajectoryCommand(motion.number, motion.trajectory, motion.name)


class Feedback(Protocol):
    """Inputs of the state machine, each computed only when it is read."""

    @property
    def time(self) -> float:
        """The station's clock, s."""

    @property
    def interrupted(self) -> bool:
        """Whether the run is to end."""

    def exposed(self) -> int:
        """Number of the last exposure."""

    def perceived(self) -> Perceived:
        """The range map."""

    def analysed(self) -> Analysed:
        """The wrinkles."""

    def planned(self) -> Planned:
        """The plan."""

    def verified(self) -> Verified:
        """The verdict."""

    def positions(self) -> Array:
        """Of the thirteen axes, rad."""

    def velocities(self) -> Array:
        """Of the thirteen axes, rad/s."""

    def controller(self) -> ControllerStatus:
        """The controller's status."""

    def grippers(self) -> GripperStatus:
        """The grippers' status."""
