"""The supervisor's state as one immutable value, and the feedback that it reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from unwrinkle.flattening.flattener import Refusal
from unwrinkle.flattening.messages import Analysed, Perceived, Planned, PlanRequest, Verified
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import PolicyState, PullDecision, Stop
from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.models.site import Site
from unwrinkle.planning.trajectory import Trajectory


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
    HOLD = "hold"  # waits for rest after an interrupt
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
    """Deadlines on the station's clock, s, and tolerances.

    Attributes:
        look: from a head command to the exposure, which waits for the units and the cloth to rest.
        rest: for the arms to come to rest at the start of a segment.
        answer: for perception, planning, verification and the controller to answer by number.
        gripper: for both grippers to have finished a stroke.
        motion: a segment may take this many times its duration, and `answer` more.
        start: largest distance of an axis from a segment's first sample, rad; the controller has
            its own.
        rest_speed: an axis slower than this is at rest, rad/s.
        replans: greatest number of new plans for one wrinkle because the robot had moved.
        speed: share of the planned speed, 0 to 1.
    """

    look: float = 30.0
    rest: float = 1.0
    answer: float = 1.0
    gripper: float = 5.0
    motion: float = 1.5
    start: float = 1e-3
    rest_speed: float = 2e-3
    replans: int = 2
    speed: float = 1.0

    @classmethod
    def of_site(cls, site: Site) -> SupervisorSettings:
        """Return deadlines that allow for the timeouts of a site's devices."""
        c, cameras = site.controller, site.cameras
        look = cameras.attempts * cameras.timeout + site.pan_tilt.motion_timeout
        return cls(
            look=max(30.0, look + 5.0),
            rest=2.0,
            answer=1.0 + c.start_timeout + c.pause,
            gripper=site.grippers.timeout + 2.0,
            start=min(c.start_tolerances),
            speed=site.speed,
        )


@dataclass(frozen=True, eq=False)
class Step(Shared):
    """A step of an action.

    Attributes:
        name: approach, close, pull, open, release or retreat.
        mode: `MOVE`, `GRIP` or `RETREAT`.
        trajectory: of a motion.
        closed: of the grippers, at the end of a stroke.
        dwell: least time for a stroke, s.
    """

    name: str
    mode: Mode
    trajectory: Trajectory | None = None
    closed: tuple[bool, bool] = (False, False)
    dwell: float = 0.0


@dataclass(frozen=True)
class StepRecord(Shared):
    """Record of an executed step; times on the station's clock, s.

    Attributes:
        name: of the step.
        number: of the command.
        sent: time of the command.
        finished: time at which the station reported it done.
    """

    name: str
    number: int
    sent: float
    finished: float


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
        sent: whether the state's command was sent.
        policy_state: of the policy.
        head, trajectory, gripper, request: last commands.
        centre: (3,) point of the world to look at next, m.
        steps: remaining steps of the action, the current one first.
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
    trajectory: TrajectoryCommand = field(default_factory=TrajectoryCommand)
    gripper: GripperCommand = field(default_factory=GripperCommand)
    request: PlanRequest = field(default_factory=PlanRequest)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    steps: tuple[Step, ...] = ()
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
    def moving(self) -> bool:
        """Whether a motion was sent and has not been reported as ended."""
        return self.mode in (Mode.MOVE, Mode.RETREAT) and self.sent


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
