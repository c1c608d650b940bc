"""What the supervisor knows, commands and remembers, as one immutable value."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from unwrinkle.flattening.messages import (
    Analysed,
    Perceived,
    Planned,
    PlanRequest,
    Shared,
    Verified,
)
from unwrinkle.flattening.policy import Memory, Pull, Sight, Stop
from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.site import Site
from unwrinkle.planning.trajectory import Trajectory

#: The states. `retreat` is a motion too; `hold` waits for rest after an interrupt.
LOOK, PERCEIVE, DECIDE, PLAN, CONFIRM = "look", "perceive", "decide", "plan", "confirm"
MOVE, GRIP, RETREAT, HOLD, DONE, FAULT = "move", "grip", "retreat", "hold", "done", "fault"
TERMINAL = (DONE, FAULT)

#: How a run stands, or ended.
RUNNING, FLAT, STOPPED, FAULTED, INTERRUPTED = "running", "flat", "stopped", "fault", "interrupted"


@dataclass(frozen=True)
class SupervisorSettings:
    """Deadlines on the station's clock, in s, and tolerances.

    Attributes:
        look: from a head command to the exposure: the units' way, the cloth's rest.
        rest: for the arms to come to rest at the start of a segment.
        answer: for perception, planning, verification and the controller to answer by number.
        gripper: for both grippers to have finished a stroke.
        motion: a segment may take this many times its duration, and `answer` more.
        start: largest distance of an axis from a segment's first sample, rad; the controller has its own.
        rest_speed: an axis slower than this is at rest, rad/s.
        replans: plans anew for one wrinkle because the robot had moved.
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
        """Deadlines that leave a site's devices the time that they may take."""
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
    """A piece of an action.

    Attributes:
        name: approach, close, pull, open, release or retreat.
        mode: move, grip or retreat.
        trajectory: of a motion.
        closed: of the grippers, at the end of a stroke.
        dwell: least time for a stroke, s.
    """

    name: str
    mode: str
    trajectory: Trajectory | None = None
    closed: tuple[bool, bool] = (False, False)
    dwell: float = 0.0


@dataclass(frozen=True)
class Refusal(Shared):
    """A wrinkle for which there was no verified motion.

    Attributes:
        wrinkle: index in the analysis.
        arms: dual or single.
        reason: in words.
    """

    wrinkle: int
    arms: str
    reason: str


@dataclass(frozen=True)
class StepRecord(Shared):
    """A piece of an action that was carried out; times on the station's clock, s.

    Attributes:
        name: of the step.
        number: of the command.
        sent: when it was commanded.
        finished: when the station had done it.
    """

    name: str
    number: int
    sent: float
    finished: float


@dataclass(frozen=True, eq=False)
class Action(Shared):
    """One look and what followed from it; complete once `outcome` is not empty.

    Attributes:
        look: number of the head command.
        began: when, on the station's clock, s.
        perceived: what the look gave.
        analysed: what was found.
        sight: what counts of it.
        pull: what was decided to pull; None where nothing.
        stop: why nothing was pulled; None where something was.
        refusals: wrinkles before it for which there was no verified motion.
        planned: the plan.
        verified: its verdict.
        steps: what was carried out.
        outcome: done, missed, blind, flat, stopped, fault or interrupted; empty while it goes on.
        reason: for an outcome that is not `done`.
        memory: the judgement's, after it.
        ended: when, on the station's clock, s.
    """

    look: int = 0
    began: float = 0.0
    perceived: Perceived | None = None
    analysed: Analysed | None = None
    sight: Sight | None = None
    pull: Pull | None = None
    stop: Stop | None = None
    refusals: tuple[Refusal, ...] = ()
    planned: Planned | None = None
    verified: Verified | None = None
    steps: tuple[StepRecord, ...] = ()
    outcome: str = ""
    reason: str = ""
    memory: Memory = field(default_factory=Memory)
    ended: float = 0.0


@dataclass(frozen=True, eq=False)
class Situation(Shared):
    """The supervisor's whole state.

    Attributes:
        mode: one of the states.
        since: when the state, or its command, began on the station's clock, s.
        sent: the state's command has been given.
        memory: the judgement's.
        head, trajectory, gripper, request: last commands.
        centre: (3,) world, what to look at next, m.
        steps: what is left of the action, the current step first.
        closed: last commanded state of the grippers.
        replans: plans anew for this wrinkle.
        action: the current look and what follows from it.
        finished: the action before; None at first.
        status: running, flat, stopped, fault or interrupted.
        reason: why it ended.
    """

    mode: str = LOOK
    since: float = 0.0
    sent: bool = False
    memory: Memory = field(default_factory=Memory)
    head: HeadCommand = field(default_factory=HeadCommand)
    trajectory: TrajectoryCommand = field(default_factory=TrajectoryCommand)
    gripper: GripperCommand = field(default_factory=GripperCommand)
    request: PlanRequest = field(default_factory=PlanRequest)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    steps: tuple[Step, ...] = ()
    replans: int = 0
    action: Action = field(default_factory=Action)
    finished: Action | None = None
    status: str = RUNNING
    reason: str = ""

    @property
    def over(self) -> bool:
        """Whether nothing will follow."""
        return self.mode in TERMINAL

    @property
    def moving(self) -> bool:
        """Whether a motion was sent and is not known to have ended."""
        return self.mode in (MOVE, RETREAT) and self.sent


class Feedback(Protocol):
    """What the supervisor can ask; each answer is worked out only when it is asked for."""

    @property
    def time(self) -> float:
        """The station's clock, s."""

    @property
    def interrupted(self) -> bool:
        """Whether somebody wants the run to end."""

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
