"""What an execution has under way."""

from dataclasses import dataclass

from unwrinkle.planning.plan import GripperEvent, Segment


@dataclass
class Move:
    """A segment under way."""

    segment: Segment
    begun: int  # number of the command that began it
    number: int  # of the last command about it
    asked: float
    started: bool = False


@dataclass
class Grip:
    """Grippers under way."""

    event: GripperEvent
    number: int
    asked: float


@dataclass
class Ending:
    """On the way to rest."""

    outcome: str
    reason: str
    asked: float
    open_grippers: bool
    opened: float | None = None
