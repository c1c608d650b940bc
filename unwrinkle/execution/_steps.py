"""Records of what an execution is doing: a running segment, a gripper event, a stop."""

from dataclasses import dataclass

from unwrinkle.planning.plan import GripperEvent, Segment


@dataclass
class RunningSegment:
    """A segment that was sent to the driver."""

    segment: Segment
    begun: int  # number of the command that started it
    number: int  # number of the last command about it
    asked: float  # time of that command, s
    started: bool = False


@dataclass
class RunningGripperEvent:
    """A gripper event that was sent to the grippers."""

    event: GripperEvent
    number: int
    asked: float  # time of the command, s


@dataclass
class Stopping:
    """A stop on its way to rest."""

    outcome: str
    reason: str
    asked: float  # time of the stop, s
    open_grippers: bool
    opened: float | None = None  # time at which the grippers were commanded to open, s
