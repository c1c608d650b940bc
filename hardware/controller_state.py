"""What drivers report: the robot's status, joint feedback, and the state of the controller's driver."""

from dataclasses import dataclass

from unwrinkle.models.arrays import Array

#: States of the controller's driver.
#: offline: not connected. connecting: to the state server; whole feedback, and a status without motion in the queues, are
#: awaited before the motion connection is made. ready: at rest, a trajectory may be run. starting: trajectory mode is being entered. running. holding: braking along the path. held: at rest on the path, it can
#: be resumed. stopping: leaving trajectory mode. fault: latched; nothing moves before a reset and a new trajectory.
OFFLINE, CONNECTING, READY, STARTING = "offline", "connecting", "ready", "starting"
RUNNING, HOLDING, HELD, STOPPING, FAULT = "running", "holding", "held", "stopping", "fault"
STATES = (OFFLINE, CONNECTING, READY, STARTING, RUNNING, HOLDING, HELD, STOPPING, FAULT)

#: A controller's answer to a question that it cannot answer.
UNKNOWN = -1


@dataclass(frozen=True)
class RobotStatus:
    """What ROBOT_STATUS says; 1 yes, 0 no, -1 unknown.

    Attributes:
        drives_powered: servo on.
        e_stopped: an emergency stop is pressed.
        error_code: of the controller; 0 none.
        in_error: an alarm or error is shown.
        in_motion: the robot moves.
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
        """Why the robot may not be moved, in plain words; empty if it may."""
        if self.e_stopped == 1:
            return "an emergency stop is pressed"
        if self.in_error == 1:
            return f"the controller shows an alarm or error (code {self.error_code})"
        if self.mode == 1:
            return "the pendant is in teach mode; turn its key to play, and to remote"
        return ""


@dataclass(frozen=True, eq=False)
class JointFeedback:
    """Where the thirteen axes are: turn-table, right arm, left arm.

    Attributes:
        positions: (13,) rad.
        velocities: (13,) rad/s.
        received: on the host's clock, s; age is reckoned from this.
        stamp: on the controller's clock, s; None where it sends none.
        count: whole sets received since the connection.
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
        state: one of `STATES`.
        command: number of the last command accepted or refused.
        completed: number of the last command done: a trajectory run to its end, or a hold at rest.
        progress: time along the running trajectory (its own clock) that the robot is commanded to by now, s.
        reason: why the last command was refused, or it holds, or is in fault; else empty.
        override: share of the planned speed.
        robot: last status of the robot; None before the first.
        feedback_age: s since the last whole feedback; infinite before the first.
        late: polls that came later than the budget allows.
        points: points that the controller has acknowledged, of the running trajectory.
        following_error: largest distance of an axis from where it was sent, rad, the lag taken out.
        lag: that fits the motion best, s.
    """

    state: str = OFFLINE
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
