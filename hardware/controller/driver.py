"""The controller's driver: one state machine for all thirteen axes, driven by `poll`.

A fault latches. What can still be commanded and seen well enough brakes along the path: feedback that ends (state
connection lost, garbage or silence on it), the I/O connection lost, a log that cannot be written, a driver that is polled
late too often. Everything else stops all groups at once with one STOP_MOTION: an axis off its path, feedback that cannot
be (not finite, beyond limits, a jump), emergency stop, teach mode, remote or servos off, an alarm, a point that the
controller refuses, a wrong, missing or overdue answer, a queue that has run out. Where the motion connection is lost
nothing can be sent: the controller's servos brake, and **what is left in its queues is run at the next connection**. So
none is made before the robot's status has said that nothing is left there.
"""

from unwrinkle.hardware.controller._driver_core import QUEUE_KEPT, QUEUE_LEFT
from unwrinkle.hardware.controller._driver_motion import ARRIVED_SPEED, DriverMotion, not_reset
from unwrinkle.hardware.controller.monitor import AXIS_NAMES
from unwrinkle.hardware.controller_state import (
    FAULT,
    HELD,
    HOLDING,
    READY,
    RUNNING,
    STARTING,
    STOPPING,
)
from unwrinkle.hardware.motoros.io_channel import IoChannel
from unwrinkle.hardware.motoros.start_sequence import StartSequence
from unwrinkle.hardware.streaming.firmware_limits import speed_shares, unmoved_group
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.hardware.streaming.trajectory_check import trajectory_problem
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.trajectory import Trajectory

__all__ = ["QUEUE_KEPT", "QUEUE_LEFT", "ControllerDriver"]


class ControllerDriver(DriverMotion):
    """Runs trajectories on the robot. Every command returns at once; `status` tells what became of it."""

    # Commands

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot stands; one that cannot be run is refused with a reason.

        Args:
            number: counts up with every command; one seen before changes nothing.
            trajectory: all thirteen axes, from rest to rest, within the limits as it is sent (see `planning.sent`).
            name: for messages.
        """
        if number <= self._command:
            return
        self._command = number
        self._reason = self._reason if self._state == FAULT else ""
        try:
            sent, problem = as_sent(trajectory), ""
        except InputError as error:
            sent, problem = trajectory, str(error)
        problem = problem or self._cannot_run(sent)
        if problem:
            self._refuse(number, name, problem)
        else:
            assert self._channel is not None
            self._waiting = (number, sent, name)
            self._most_override = self._governed(sent)
            earliest = self._rest_since + self.site.pause
            self._stream = None
            self._start = StartSequence(self.site, self._channel, self._in_mode, earliest)
            self._state = STARTING
            self._event("run", f"trajectory {number} {name}".strip(), duration=trajectory.duration)
        self._publish()

    def hold(self, number: int) -> None:
        """Brake along the path to rest: `held`, or `ready` where that is the path's end; at rest it is done at once."""
        if number <= self._command:
            return
        self._command = number
        if self._state in (RUNNING, HOLDING):
            self._hold_number = number
            self._hold("hold commanded")
        elif self._state == STARTING:
            self._waiting, self._start, self._state = None, None, READY
            self._completed, self._reason = number, "hold commanded before the motion began"
        elif self._state in (READY, HELD):
            self._completed = number
        self._publish()

    def resume(self, number: int) -> None:
        """Go on along the path after a hold; `completed` gets this number at its end."""
        if number <= self._command:
            return
        self._command, stream = number, self._stream
        problem = f"there is nothing to resume, the driver is {self._state}"
        if self._state in (HOLDING, HELD) and stream is not None:
            problem = self._cannot_resume(stream)
            if not problem:
                self._number, self._reason, self._ended = number, "", None
                self._hold_number = 0
                self._state = RUNNING
                stream.clock.set_rate(self._override)
                self._event("resume", f"resumed by command {number}")
        if problem and self._state != FAULT:
            self._reason = f"resume {number} refused: {problem}"
        self._publish()

    def stop(self, reason: str) -> None:
        """Hold, then leave trajectory mode; what ran cannot be resumed."""
        if self._state in (RUNNING, HOLDING, HELD, STARTING, READY):
            if self._state in (RUNNING, HOLDING):
                self._hold(reason)
            elif self._state != HELD:
                self._stream = None
            self._ended = None
            self._waiting, self._start = None, None
            self._state, self._reason, self._leaving = STOPPING, reason, None
            self._event("stop", reason)
        self._publish()

    def reset(self) -> None:
        """Leave a fault, if the robot is at rest and its status allows; what ran is gone."""
        if self._state != FAULT:
            return
        problem = self._cannot_reset()
        if problem:
            self._reason = not_reset(self._reason, problem)
        else:
            self._resetting = self._now
            self._next_ask = float("-inf")
        self._publish()

    def set_override(self, value: float) -> None:
        """Run at a share of the planned speed, 0 to 1, from now on; anything else is refused and changes nothing.

        Shares just below 1 are run at `path_clock.NEARLY`.
        """
        if not 0.0 <= value <= 1.0:
            if self._state != FAULT:
                self._reason = f"speed override {value} refused: give 0 to 1"
            self._publish()
            return
        if self._state in (RUNNING, HOLDING, HELD) and not value <= self._most_override:
            self._reason = (
                f"speed override {value:g} refused: the controller's speed governor allows "
                f"{self._most_override:.3f} of this trajectory's speed"
            )
            self._publish()
            return
        changed = value != self._override
        self._override = float(value)
        if self._state == RUNNING and self._stream is not None:
            self._stream.clock.set_rate(self._override)
        if changed:
            self._event("override", f"speed override {value:g}", value=float(value))
        self._publish()

    def write_output(self, address: int, value: int) -> None:
        """Set a digital output, 0 or 1; `outputs_written` tells when it is done.

        Raises:
            HardwareError: there is no I/O connection.
        """
        self._connected_io().write(address, value)
        self._event("output", f"output {address} to {value}", address=address, value=value)

    def read_input(self, address: int) -> None:
        """Read a digital input; `inputs` gets its value.

        Raises:
            HardwareError: there is no I/O connection.
        """
        self._connected_io().read(address)

    # Time

    def poll(self, now: float) -> None:
        """Read what came, judge it, and send what is due; never blocks.

        Args:
            now: of any monotonic clock, s.
        """
        if not self.links:
            return
        gap, first = (now - self._now, False) if self._polled else (0.0, True)
        self._now = now
        if first:  # only now the time is known
            self._polled, self._since = True, now
            self._event("connect", f"connected to {self.site.host}")
        moving = self._stream is not None and not self._stream.at_rest(now)
        new = self._read(now)
        self._take_answers(now)
        self._judge(now, gap, moving, new)
        self._step(now)
        self._publish()

    # Why something cannot be done; empty if it can

    def _cannot_run(self, trajectory: Trajectory) -> str:
        if self._state == FAULT:
            return f"the driver is in fault ({self._reason}); reset it and plan anew"
        if self._state not in (READY, HELD):
            return f"the driver is {self._state}; wait until it is ready"
        return (
            trajectory_problem(trajectory, self.limits, AXIS_NAMES)
            or self._beyond_firmware(trajectory)
            or self._cannot_start(trajectory)
        )

    def _beyond_firmware(self, trajectory: Trajectory) -> str:
        """What the controller would take and not carry out, or refuse in the midst of the motion."""
        if still := unmoved_group([trajectory], self.site.groups_moved):
            return still
        most = self._governed(trajectory)
        if not self._override <= most:
            axis = int(speed_shares([trajectory], self._cap).argmax())
            return (
                f"{AXIS_NAMES[axis]} is to move at {self._override / most:.2f} of what the controller's speed governor "
                f"allows (controller.speed_cap {self.site.speed_cap:g}); at most {most:.3f} of the planned speed"
            )
        return ""

    def _governed(self, trajectory: Trajectory) -> float:
        """Share of a trajectory's speed that the controller's speed governor allows, up to 1."""
        used = float(speed_shares([trajectory], self._cap).max())
        return 1.0 if used <= 1.0 else 1.0 / used

    def _cannot_resume(self, stream: PointStream) -> str:
        last = stream.clock.last
        if stream.clock.done or last is None:
            return "the trajectory is at its end"
        if self._robot is None or self.feedback is None:
            return "nothing is known of the robot"
        if self._robot.problem:
            return self._robot.problem
        if self._age(self._now) > self.site.hold_after:
            return (
                f"feedback is {self._age(self._now):.2f} s old, at most {self.site.hold_after:g} s"
            )
        if self._state == HOLDING:  # still under way
            return ""
        return self._monitor.stands(self.feedback, last.positions)

    def _cannot_reset(self) -> str:
        lost = self._reader is None or self._channel is None
        if lost or (self._needs_io and self._io is None):
            return "a connection is lost; close the driver and connect again"
        if self._log_problem:
            return self._log_problem
        if self._braking is not None:
            return "the robot is still braking"
        if self.feedback is None or self._age(self._now) > self.site.hold_after:
            return "feedback is missing or old"
        speed = abs(self.feedback.velocities).max()
        if not speed <= ARRIVED_SPEED:
            return f"the robot moves ({speed:.3f} rad/s)"
        robot = self._robot
        if robot is None or (robot.problem and robot.in_error != 1) or robot.e_stopped == 1:
            return "its status is not known" if robot is None else robot.problem
        return ""

    def _connected_io(self) -> IoChannel:
        if self._io is None:
            raise HardwareError(
                f"no I/O connection to {self.site.host}:{self.site.io_port}; connect first"
            )
        return self._io
