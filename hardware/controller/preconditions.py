"""What has to hold before a command is carried out: each check gives the reason for a refusal,
empty if there is none.
"""

from dataclasses import dataclass

from unwrinkle.hardware.controller.monitor import AXIS_NAMES, Monitor
from unwrinkle.hardware.controller_state import JointFeedback, RobotStatus
from unwrinkle.hardware.streaming.firmware_limits import speed_shares, unmoved_group
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.hardware.streaming.trajectory_check import trajectory_problem
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.arrival import ARRIVED_SPEED_RAD_S
from unwrinkle.planning.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class RobotView:
    """What is known of the robot at one time.

    Attributes:
        robot: newest status; None before the first.
        feedback: newest set of joint feedback; None before the first.
        age: of the feedback, s; infinite before the first.
    """

    robot: RobotStatus | None
    feedback: JointFeedback | None
    age: float


class Preconditions:
    """Checks commands against the site, the axis limits and the state of the robot."""

    def __init__(
        self, site: ControllerSite, limits: Limits, monitor: Monitor, speed_cap: Array
    ) -> None:
        """Check with these settings.

        Args:
            site: of the controller.
            limits: of the axes.
            monitor: checks whether the robot stands at a position.
            speed_cap: (13,) greatest speeds that the controller's speed governor allows, rad/s.
        """
        self._site = site
        self._limits = limits
        self._monitor = monitor
        self._speed_cap = speed_cap

    def most_override(self, trajectory: Trajectory) -> float:
        """Return the share of a trajectory's speed that the controller's speed governor allows, up
        to 1.
        """
        used = float(speed_shares([trajectory], self._speed_cap).max())
        return 1.0 if used <= 1.0 else 1.0 / used

    def trajectory(self, trajectory: Trajectory, override: float) -> str:
        """Check a trajectory against the axis limits and the firmware, run at a speed override."""
        return trajectory_problem(trajectory, self._limits, AXIS_NAMES) or self._firmware(
            trajectory, override
        )

    def _firmware(self, trajectory: Trajectory, override: float) -> str:
        """Check for groups that the firmware does not move, and for its speed governor."""
        if still := unmoved_group([trajectory], self._site.groups_moved):
            return still
        most = self.most_override(trajectory)
        if not override <= most:
            axis = int(speed_shares([trajectory], self._speed_cap).argmax())
            return (
                f"{AXIS_NAMES[axis]} is to move at {override / most:.2f} of what the controller's "
                f"speed governor allows (controller.speed_cap {self._site.speed_cap:g}); at most "
                f"{most:.3f} of the planned speed"
            )
        return ""

    def start(self, view: RobotView, trajectory: Trajectory) -> str:
        """Check that the robot may move and stands at the trajectory's first sample."""
        if view.robot is None or view.feedback is None:
            return "nothing is known of the robot yet"
        if view.robot.problem:
            return view.robot.problem
        if view.age > self._site.hold_after:
            return f"feedback is {view.age:.2f} s old, at most {self._site.hold_after:g} s"
        return self._monitor.stands(view.feedback, trajectory.positions[0])

    def resume(self, view: RobotView, stream: PointStream, *, braking: bool) -> str:
        """Check that a held motion can go on; while it is still `braking` the robot need not stand
        anywhere.
        """
        last = stream.clock.last
        if stream.clock.done or last is None:
            return "the trajectory is at its end"
        if view.robot is None or view.feedback is None:
            return "nothing is known of the robot"
        if view.robot.problem:
            return view.robot.problem
        if view.age > self._site.hold_after:
            return f"feedback is {view.age:.2f} s old, at most {self._site.hold_after:g} s"
        if braking:
            return ""
        return self._monitor.stands(view.feedback, last.positions)

    def reset(self, view: RobotView) -> str:
        """Check that the robot is at rest and its status permits leaving a fault; an alarm may be
        cleared.
        """
        if view.feedback is None or view.age > self._site.hold_after:
            return "feedback is missing or old"
        speed = abs(view.feedback.velocities).max()
        if not speed <= ARRIVED_SPEED_RAD_S:
            return f"the robot moves ({speed:.3f} rad/s)"
        robot = view.robot
        if robot is None or (robot.problem and robot.in_error != 1) or robot.e_stopped == 1:
            return "its status is not known" if robot is None else robot.problem
        return ""
