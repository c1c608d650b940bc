"""What the controller's driver does in each state: how it starts, runs, holds, leaves and stops for a fault."""

import numpy as np

from unwrinkle.hardware.controller._driver_core import QUEUE_KEPT, QUEUE_LEFT, DriverCore
from unwrinkle.hardware.controller.monitor import AXIS_NAMES, Finding
from unwrinkle.hardware.controller_state import (
    CONNECTING,
    FAULT,
    HELD,
    HOLDING,
    READY,
    RUNNING,
    STARTING,
    STOPPING,
    UNKNOWN,
)
from unwrinkle.hardware.motoros.motion_channel import Asked, MotionChannel, StopAndPart
from unwrinkle.hardware.motoros.start_sequence import StartSequence
from unwrinkle.hardware.motoros.wire import Command, MotionReply, Result, describe
from unwrinkle.hardware.streaming.path_clock import PathClock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import HardwareError
from unwrinkle.planning.trajectory import Trajectory

#: Within these of its last point (and the start tolerance) a trajectory is completed, rad and rad/s; so long after its end
#: that may take, s.
ARRIVED, ARRIVED_SPEED, ARRIVAL_TIME = 5e-4, 5e-3, 1.0
#: A controller in trajectory mode that was asked nothing for so long is asked whether it is there, s.
HEARTBEAT = 1.0
#: A braking along the path that takes longer is given up, s.
LONGEST_BRAKING = 10.0
_AGAIN = 0.05  # s, until something that was refused for now is asked again
_LONGEST = 2.0  # s, for leaving trajectory mode and for clearing an alarm


class DriverMotion(DriverCore):
    """The driver's states."""

    _waiting: tuple[int, Trajectory, str] | None = None  # number, trajectory, name, while starting
    _start: StartSequence | None = None
    _ended: float | None = None  # when what was sent had been run to rest
    _seen_possible = False  # the robot said that motion is possible, since it moves
    _leaving: float | None = None  # since when
    _next_ask = float("-inf")
    _resetting: float | None = None  # since when

    def _take_answers(self, now: float) -> None:
        channel = self._channel
        if self._parting is not None and self._parting.poll(now):
            self._parting = None
        if channel is None:
            return
        try:
            answers = channel.poll(now)
        except HardwareError as error:
            self._motion_lost(channel, str(error), now)
            return
        for asked, reply in answers:
            self._answered(asked, reply, now)

    def _motion_lost(self, channel: MotionChannel, text: str, now: float) -> None:
        """Latch a fault; where the connection is still there, stop all groups before it is closed."""
        stream = self._stream
        moving = stream is not None and not stream.at_rest(now)
        self._channel = None
        if stream is not None:
            stream.stop()
        if channel.open and self._mode_asked:
            waiting = not channel.quiet
            self._parting = StopAndPart(self.links["motion"], now, waiting=waiting)
            self._event("stop", "all groups stopped at once, then the motion connection is closed")
            if moving:
                text = (
                    f"{text}; a stop of all groups is sent before the connection is closed, whether it is carried out is "
                    "not known: `unwrinkle site check` tells whether motion is left in the queues"
                )
        else:
            self.links["motion"].close(text)
            if moving and self._state == FAULT:
                self._reason = f"{self._reason}; {QUEUE_KEPT}"
            text = f"{text}; {QUEUE_KEPT}" if moving else text
        self._fault(Finding("motion", text))

    def _answered(self, asked: Asked, reply: MotionReply, now: float) -> None:
        success = reply.result == Result.SUCCESS
        if asked.what == Command.START_TRAJ_MODE:
            self._in_mode = success and self._state != FAULT
        elif asked.what == Command.STOP_TRAJ_MODE and success:
            self._in_mode = False
        elif asked.what == Command.CHECK_MOTION_READY and not success:
            self._in_mode = False
            if self._state == HELD:
                text = describe(Result.NOT_READY, reply.subcode)
                self._fault(
                    Finding("robot", f"the robot was made unready while it was held: {text}")
                )
        if self._start is not None:
            self._start.answered(asked, reply, now)
        if self._stream is not None:
            self._stream.answered(asked, reply, now)

    def _judge(self, now: float, gap: float, moving: bool, new: bool) -> None:
        monitor, stream, feedback = self._monitor, self._stream, self.feedback
        if late := monitor.polled(gap, moving):
            self._fault(late)
        if self._log_problem and self._state != FAULT:
            self._fault(Finding("log", self._log_problem, brake=True))
        age = self._age(now)
        if age > self.site.fault_after and self._state != CONNECTING:
            self._fault(self._too_old(now))
        if stream is None:
            return
        if stream.problem:
            self._fault(Finding("stream", stream.problem))
        elif empty := stream.ran_out(now):
            self._fault(Finding("late", f"{empty} (last poll {1e3 * gap:.0f} ms ago)"))
        if self._state not in (RUNNING, HOLDING, HELD, STOPPING) and self._braking is None:
            return
        if new and feedback is not None and (off := monitor.follows(feedback, stream)):
            self._fault(off)
        robot = self._robot
        self._seen_possible |= robot is not None and robot.motion_possible == 1
        if wrong := monitor.robot(robot, self._seen_possible):
            self._fault(wrong)
        if age > self.site.hold_after and self._state == RUNNING:
            self._hold(f"feedback is {age:.2f} s old, at most {self.site.hold_after:g} s")

    def _too_old(self, now: float) -> Finding:
        text = f"feedback is {self._age(now):.2f} s old, at most {self.site.fault_after:g} s"
        return Finding("feedback", text, brake=True)

    def _step(self, now: float) -> None:
        state, stream = self._state, self._stream
        if state == CONNECTING:
            self._connecting(now)
        elif state == STARTING:
            self._starting(now)
        elif state == STOPPING:
            self._stopping(now)
        elif state == FAULT:
            self._faulted(now)
        elif stream is not None:
            stream.poll(now)
            if state == RUNNING:
                self._running(now, stream)
            elif state == HOLDING:
                self._holding(now, stream)
        channel = self._channel
        if channel is not None:
            channel.send_next(now)
        if (
            self._in_mode
            and channel is not None
            and channel.quiet
            and now - channel.used > HEARTBEAT
            and self._state in (READY, HELD, RUNNING)
        ):
            channel.control(Command.CHECK_MOTION_READY, now)

    def _connecting(self, now: float) -> None:
        robot, reader = self._robot, self._reader
        known = robot is not None and UNKNOWN not in (
            robot.drives_powered,
            robot.e_stopped,
            robot.in_error,
            robot.in_motion,
            robot.mode,
        )
        if self.feedback is not None and known and robot is not None and robot.in_motion == 0:
            try:
                self._connect_motion()
            except HardwareError as error:
                self._fault(Finding("connect", str(error)))
                return
            self._state = READY
            self._event("ready", "feedback and status are whole, and nothing is in the queues")
        elif now - self._since > self.site.connect_timeout:
            missing = "" if reader is None else reader.missing
            text = "the robot's status says 'unknown'" if robot else "no status has come"
            if self.feedback is None:
                text = f"no feedback has come of groups {missing}; compare the site's groups and profile with the controller's"
            elif known:
                self._fault(Finding("queue", QUEUE_LEFT))
                return
            self._fault(Finding("handshake", f"after {now - self._since:.1f} s {text}"))

    def _starting(self, now: float) -> None:
        start, waiting = self._start, self._waiting
        assert start is not None and waiting is not None and self._channel is not None
        number, trajectory, name = waiting
        if not self._mode_asked and now >= self._rest_since + self.site.pause:
            self._mode_asked = True
        start.poll(now)
        problem = start.problem
        if start.done and not problem:
            problem = self._cannot_start(trajectory)
        if not problem and not start.done:
            return
        self._start, self._waiting = None, None
        self._state = READY
        if problem:
            self._refuse(number, name, problem)
            return
        limits = StreamLimits.of(self.limits)
        clock = PathClock(trajectory, limits, rate=self._override)
        self._stream = PointStream(clock, self.site, self._channel, self._record)
        self._number = self._path_number = number
        self._hold_number = 0
        self._ended, self._seen_possible = None, False
        self._monitor.restart()
        self._state = RUNNING
        self._stream.poll(now)

    def _running(self, now: float, stream: PointStream) -> None:
        if not stream.ended(now):
            return
        off = self._off(now, stream)
        if off is None:
            self._state, self._completed = READY, max(self._completed, self._number)
            self._rest_since = now
            self._event("completed", f"the trajectory of command {self._number} is done")

    def _holding(self, now: float, stream: PointStream) -> None:
        if stream.at_rest(now) and self._off(now, stream) is None:
            self._state = READY if stream.clock.done else HELD
            self._completed = max(self._completed, self._hold_number)
            if stream.clock.done:  # it had come to its end all the same
                self._completed = max(self._completed, self._number)
                self._reason = ""
            self._rest_since = now
            self._event("held", f"at rest {stream.progress(now):.3f} s along the trajectory")

    def pause(self, reason: str) -> None:
        """Brake along the path, if a trajectory runs, until somebody resumes; for whoever watches over the driver's owner."""
        if self._state == RUNNING:
            self._hold(reason)

    def _off(self, now: float, stream: PointStream) -> Array | None:
        """How far the robot is off the point of rest, (13,) rad; None once it is there and stands."""
        if self._ended is None:
            self._ended = now
        feedback, last = self.feedback, stream.clock.last
        assert feedback is not None and last is not None
        off = np.abs(feedback.positions - last.positions)
        most = np.minimum(self.site.start_tolerances, ARRIVED)  # the next motion begins here
        if (
            feedback.received > self._ended
            and (off <= most).all()
            and np.abs(feedback.velocities).max() <= ARRIVED_SPEED
        ):
            return None
        if now - self._ended > ARRIVAL_TIME + self.site.latency:
            axis = int((off / most).argmax())
            self._fault(
                Finding(
                    "arrival",
                    f"{AXIS_NAMES[axis]} is still {1e3 * off[axis]:.2f} mrad off where the motion ended "
                    f"{now - self._ended:.1f} s ago, at most {1e3 * most[axis]:.2f} mrad, or moves",
                )
            )
        return off

    def _stopping(self, now: float) -> None:
        """Come to rest, then leave trajectory mode; refused while queues are not empty, so ask again."""
        stream, channel = self._stream, self._channel
        if stream is not None:
            stream.poll(now)
            if not stream.at_rest(now) or self._off(now, stream) is not None:
                return
        if self._leaving is None:
            self._leaving = now
        if channel is not None and not channel.quiet:
            return  # trajectory mode may be on its way
        if not self._in_mode or channel is None:
            self._stream, self._state = None, READY
            self._rest_since = now
        elif now - self._leaving > _LONGEST:
            self._fault(
                Finding("leave", f"trajectory mode could not be left within {_LONGEST:g} s")
            )
        elif now >= self._next_ask:
            channel.control(Command.STOP_TRAJ_MODE, now)
            self._next_ask = now + _AGAIN

    def _faulted(self, now: float) -> None:
        stream = self._stream
        if self._braking is not None and stream is not None:
            stream.poll(now)
            if stream.at_rest(now):
                self._braking = None
                self._event("rest", "at rest after braking along the path")
            elif now - self._braking > LONGEST_BRAKING:
                self._fault(Finding("brake", f"no rest after {LONGEST_BRAKING:g} s of braking"))
        if self._resetting is not None:
            self._reset_on(now, self._resetting)

    def _reset_on(self, now: float, since: float) -> None:
        """Clear the controller's alarm, if it shows one; then the latch is open."""
        robot, channel = self._robot, self._channel
        if channel is None or robot is None:
            self._resetting = None
        elif robot.in_error != 1:
            self._resetting, self._stream = None, None
            self._start, self._waiting = None, None
            self._state, self._reason = READY, ""
            self._rest_since = now
            self._event("reset", "the fault was reset; a new trajectory is needed")
        elif now - since > _LONGEST:
            self._resetting = None
            self._reason = not_reset(self._reason, robot.problem)
        elif channel.quiet and now >= self._next_ask:
            self._next_ask = now + 10.0 * _AGAIN
            channel.control(Command.RESET_ALARM, now)

    def _hold(self, reason: str) -> None:
        """Brake along the path."""
        assert self._stream is not None
        if self._state == RUNNING:
            self._ended = None
            self._event("hold", reason)
        self._state, self._reason = HOLDING, reason
        self._stream.clock.set_rate(0.0)

    # Why something cannot be done; empty if it can

    def _cannot_start(self, trajectory: Trajectory) -> str:
        """Whether robot and feedback allow motion from the trajectory's first sample."""
        if self._robot is None or self.feedback is None:
            return "nothing is known of the robot yet"
        if self._robot.problem:
            return self._robot.problem
        age = self._age(self._now)
        if age > self.site.hold_after:
            return f"feedback is {age:.2f} s old, at most {self.site.hold_after:g} s"
        return self._monitor.stands(self.feedback, trajectory.positions[0])

    def _refuse(self, number: int, name: str, problem: str) -> None:
        label = f"trajectory {number}" + (f" ({name})" if name else "")
        text = f"{label} refused: {problem}"
        if self._state != FAULT:
            self._reason = text
        self._event("refused", text)


def not_reset(reason: str, problem: str) -> str:
    """A fault's reason, and why it was not reset."""
    return f"{reason.split(' [not reset')[0]} [not reset: {problem}]"
