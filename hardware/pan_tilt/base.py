"""Interface of a pan-tilt unit's driver."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class PanTiltState(StrEnum):
    """States of a unit's driver."""

    STARTING = "starting"  # the resolution and limits are being read
    READY = "ready"  # at rest
    MOVING = "moving"
    SETTLING = "settling"  # arrived, but the mount may still swing
    FAULT = "fault"  # latched; nothing is sent before a restart


@dataclass(frozen=True)
class PanTiltStatus:
    """State of a unit.

    Attributes:
        state: see `PanTiltState`.
        number: of the last command accepted or refused.
        still: whether the unit and its mount are at rest, and no command waits.
        pan, tilt: as the unit reports them, rad; 0 before the first report.
        reason: why the last command was refused, or a fault is latched; else empty.
    """

    state: PanTiltState = PanTiltState.STARTING
    number: int = 0
    still: bool = False
    pan: float = 0.0
    tilt: float = 0.0
    reason: str = ""


class PanTilt(Protocol):
    """Driver of one pan-tilt unit.

    Attributes:
        name: of the unit, for messages.
    """

    name: str

    @property
    def status(self) -> PanTiltStatus:
        """State as of the last poll."""
        ...

    def goto(self, number: int, pan: float, tilt: float) -> None:
        """Go to angles, rad; `number` counts up with every command."""
        ...

    def poll(self, now: float) -> None:
        """Read, decide and write without waiting; `now` is of any clock, s."""
        ...

    def close(self) -> None:
        """Disconnect; the unit stays as it is."""
        ...
