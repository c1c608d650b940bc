"""Values of an execution: feedback, the operator's wishes, commands, state and result."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from unwrinkle.flattening.execution.steps import STROKES, Step, StepRecord
from unwrinkle.flattening.station_messages import ControllerStatus, GripperCommand, GripperStatus
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.planning.trajectory import Trajectory


class Phase(StrEnum):
    """What an execution does."""

    IDLE = "idle"  # before the first plan, and after the end of each
    WAITING = "waiting"  # for rest at the start of a step, or for the operator
    MOVING = "moving"  # a segment was sent
    GRIPPING = "gripping"  # a stroke was sent
    STOPPING = "stopping"  # coming to rest
    OPENING = "opening"  # opens the grippers at rest, then ends


class Outcome(StrEnum):
    """How an execution ended."""

    DONE = "done"
    MISSED = "missed"  # the grasp closed on nothing, or the cloth was lost; the steps are done
    STOPPED = "stopped"  # by the operator, a signal or a closed page
    FAILED = "failed"


class MotionKind(StrEnum):
    """Kinds of a motion command."""

    RUN = "run"
    HOLD = "hold"  # brake along the path; it can be resumed
    RESUME = "resume"
    STOP = "stop"  # brake along the path; it cannot be resumed


@dataclass(frozen=True, eq=False)
class MotionCommand(Shared):
    """Command to the controller of the axes.

    Attributes:
        number: counts up with every new command; 0 is none.
        kind: of the command.
        name: of the segment that it is about.
        trajectory: to run; None for any other kind.
        reason: of a stop.
    """

    number: int = 0
    kind: MotionKind = MotionKind.HOLD
    name: str = ""
    trajectory: Trajectory | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class ExecutionFeedback:
    """What is known of the robot at one time.

    Attributes:
        time: of any monotonic clock, s.
        positions: of all axes, (A,) rad.
        velocities: of all axes, (A,) rad/s.
        controller: status of the controller.
        grippers: status of the grippers; None where there are none: strokes are pauses.
        age: of positions and velocities, s; infinite where nothing was received.
    """

    time: float
    positions: Array
    velocities: Array
    controller: ControllerStatus
    grippers: GripperStatus | None
    age: float = 0.0


@dataclass(frozen=True)
class OperatorWishes:
    """Wishes of the operator, and of the program around the executor, since the last step.

    Attributes:
        fail: reason for which the execution ends as failed; empty for none.
        stop: reason for which it ends as stopped; empty for none.
        hold: reason for which it is held until `resume`; empty for none.
        resume: end a hold; ignored together with `hold`.
        speed: new share of the planned speed; None for none.
        alive: the dead-man key was pressed.
    """

    fail: str = ""
    stop: str = ""
    hold: str = ""
    resume: bool = False
    speed: float | None = None
    alive: bool = False


@dataclass(frozen=True)
class ExecutionEvent:
    """Event for a run log.

    Attributes:
        kind: segment, gripper, hold, resume, speed, end or result.
        text: for a reader.
        data: for a program.
    """

    kind: str
    text: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ExecutionResult:
    """Result of an execution.

    Attributes:
        outcome: how it ended.
        reason: why, for any outcome but done.
        finished: names of the segments that were run to their end.
    """

    outcome: Outcome
    reason: str
    finished: tuple[str, ...]


@dataclass(frozen=True)
class Ending:
    """Stop on its way to rest.

    Attributes:
        outcome, reason: of the result.
        open_grippers: whether the grippers are opened at rest.
    """

    outcome: Outcome
    reason: str
    open_grippers: bool = False


@dataclass(frozen=True, eq=False)
class ExecutionState(Shared):
    """State of an executor; numbers of commands count up over all its plans.

    Attributes:
        phase: what it does.
        steps: remaining steps, the present one first.
        back: steps after a missed grasp.
        arms: whether the right and the left arm take part.
        since: time at which the phase, its command or a stop began, s.
        asked: time of the last motion command, s.
        allowed_from: time from which the duration of the running segment counts, s.
        begun: number of the command that started the running segment.
        motion, gripper: last commands.
        speed: commanded share of the planned speed.
        closed: commanded state of the grippers once the last stroke was done.
        held: reason of a hold; empty for none.
        released: whether the release of the dead-man key holds it.
        alive_at: time of the last press of the dead-man key, s.
        missed: reason why the grasp counts as missed; empty while it does not.
        ending: stop under way; None for none.
        records: executed steps.
        events: of the last step.
        result: None until the end.
    """

    phase: Phase = Phase.IDLE
    steps: tuple[Step, ...] = ()
    back: tuple[Step, ...] = ()
    arms: tuple[bool, bool] = (True, True)
    since: float = 0.0
    asked: float = 0.0
    allowed_from: float = 0.0
    begun: int = 0
    motion: MotionCommand = field(default_factory=MotionCommand)
    gripper: GripperCommand = field(default_factory=GripperCommand)
    speed: float = 1.0
    closed: tuple[bool, bool] = (False, False)
    held: str = ""
    released: bool = False
    alive_at: float = float("-inf")
    missed: str = ""
    ending: Ending | None = None
    records: tuple[StepRecord, ...] = ()
    events: tuple[ExecutionEvent, ...] = ()
    result: ExecutionResult | None = None

    @property
    def running(self) -> bool:
        """Whether a plan is being executed."""
        return self.phase != Phase.IDLE

    @property
    def finished(self) -> tuple[str, ...]:
        """Names of the segments that were run to their end."""
        return tuple(record.name for record in self.records if record.name not in STROKES)

    @property
    def activity(self) -> str:
        """Present activity in a few words."""
        if self.result is not None:
            return self.result.outcome
        if self.phase in (Phase.STOPPING, Phase.OPENING):
            return "coming to rest"
        if self.phase == Phase.GRIPPING:
            return "closing grippers" if any(self.steps[0].closed) else "opening grippers"
        return self.steps[0].name if self.phase == Phase.MOVING else "waiting"
