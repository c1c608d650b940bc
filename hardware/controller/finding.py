"""A condition that stops the robot: its cause, a sentence for the user, and how the robot is
stopped for it.
"""

from dataclasses import dataclass
from enum import StrEnum


class FaultCause(StrEnum):
    """What a fault was latched for."""

    HANDSHAKE = "handshake"  # no complete feedback or status after connecting
    QUEUE = "queue"  # motion is left in the controller's queues
    CONNECT = "connect"  # the motion connection cannot be made
    MOTION = "motion"  # the motion connection failed
    STATE = "state"  # the state connection failed
    IO = "io"  # the I/O connection failed
    FEEDBACK = "feedback"  # too old, not finite, or beyond the axis limits
    JUMP = "jump"  # an axis moved farther than it can
    FOLLOWING = "following"  # an axis is off its path
    ROBOT = "robot"  # emergency stop, alarm, teach mode, servos off, motion not possible
    STREAM = "stream"  # the controller refused a point, or was busy for too long
    LATE = "late"  # the driver was polled late, or the queues ran out
    CLOCK = "clock"  # the host's clock went back
    ARRIVAL = "arrival"  # no rest at the last point
    LEAVE = "leave"  # trajectory mode could not be left
    BRAKE = "brake"  # braking along the path took too long
    LOG = "log"  # the run log cannot be written
    ERROR = "error"  # reported from outside the driver


@dataclass(frozen=True)
class Finding:
    """A condition that latches a fault.

    Attributes:
        kind: cause of the fault.
        text: sentence for the user.
        brake: True if the robot can still brake along its path; otherwise it is stopped at once.
    """

    kind: FaultCause
    text: str
    brake: bool = False
