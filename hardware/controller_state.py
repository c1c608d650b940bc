"""Values that the controller's driver reports: the robot's status, joint feedback, and its own
state.
"""

from dataclasses import dataclass
from enum import StrEnum

from unwrinkle.models.arrays import Array
from unwrinkle.planning.motion_mode import MotionMode


class DriverState(StrEnum):
    """States of the controller's driver."""

    OFFLINE = "offline"  # not connected
    CONNECTING = (
        "connecting"  # waits for complete feedback and a status without motion in the queues
    )
    READY = "ready"  # at rest; a trajectory may be run
    STARTING = "starting"  # trajectory mode is being entered
    RUNNING = "running"
    HOLDING = "holding"  # braking along the path
    HELD = "held"  # at rest on the path; it can be resumed
    STOPPING = "stopping"  # comes to rest and leaves trajectory mode
    FAULT = "fault"  # latched; nothing moves before a reset and a new trajectory


OFFLINE, CONNECTING, READY, STARTING, RUNNING, HOLDING, HELD, STOPPING, FAULT = DriverState

#: Modes of motion by the driver's state.
MOTION_MODES = {
    OFFLINE: MotionMode.FAULT,
    CONNECTING: MotionMode.IDLE,
    READY: MotionMode.IDLE,
    STARTING: MotionMode.RUNNING,
    RUNNING: MotionMode.RUNNING,
    HOLDING: MotionMode.HOLDING,
    HELD: MotionMode.HELD,
    STOPPING: MotionMode.HOLDING,
    FAULT: MotionMode.FAULT,
}

#: Value of a status field that the controller does not know.
UNKNOWN = -1


@dataclass(frozen=True)
class RobotStatus:
    """Content of ROBOT_STATUS; 1 yes, 0 no, -1 unknown.

    Attributes:
        drives_powered: servos on.
        e_stopped: an emergency stop is pressed.
        error_code: of the controller; 0 none.
        in_error: an alarm or error is shown.
        in_motion: the robot moves, or has motion in its queues.
        mode: 1 teach, 2 play (remote), -1 unknown.
        motion_possible: trajectories may be run.
    """

    drives_powered: int = UNKNOWN
    e_stopped: int = UNKNOWN
    error_code: int = 0
    in_error: int = UNKNOWN
    in_motion: int = UNKNOWN
    mode: int = UNKNOWN
    motion_possible: int = UNKNOWN

    @property
    def problem(self) -> str:
        """Reason why the robot may not be moved; empty if it may."""
        if self.e_stopped == 1:
            return "an emergency stop is pressed"
        if self.in_error == 1:
            return f"the controller shows an alarm or error (code {self.error_code})"
        if self.mode == 1:
            return "the pendant is in teach mode; turn its key to play, and to remote"
        return ""


@dataclass(frozen=True, eq=False)
class JointFeedback:
    """Positions and velocities of the thirteen axes: turn-table, right arm, left arm.

    Attributes:
        positions: (13,) rad.
        velocities: (13,) rad/s.
        received: time of reception on the host's clock, s; the feedback's age counts from here.
        stamp: on the controller's clock, s; None if the controller sends none.
        count: complete sets received since the connection was made.
    """

    positions: Array
    velocities: Array
    received: float
    stamp: float | None = None
    count: int = 0


@dataclass(frozen=True)
class DriverStatus:
    """The state of the controller's driver.

    Attributes:
        state: see `DriverState`.
        command: number of the last command accepted or refused.
        completed: number of the last command done: a trajectory run to its end, or a hold at rest.
        progress: time on the running trajectory's own clock that the robot is commanded to now, s.
        reason: why the last command was refused, the robot holds, or a fault is latched; else
            empty.
        override: share of the planned speed, 0 to 1.
        robot: newest status of the robot; None before the first.
        feedback_age: time since the newest complete feedback, s; infinite before the first.
        late: number of polls later than the site allows, since the trajectory began.
        points: points of the running trajectory that the controller has acknowledged.
        following_error: largest distance of an axis from its commanded path with the lag removed,
            rad.
        lag: estimated lag of the feedback behind the commands, s.
    """

    state: DriverState = OFFLINE
    command: int = 0
    completed: int = 0
    progress: float = 0.0
    reason: str = ""
    override: float = 1.0
    robot: RobotStatus | None = None
    feedback_age: float = float("inf")
    late: int = 0
    points: int = 0
    following_error: float = 0.0
    lag: float = 0.0
