"""Driver of the robot controller: one state machine for all thirteen axes, driven by `poll`.

A fault latches. There are two ways to stop for it:

- braking along the path, where the robot can still be commanded and observed well enough: the state
  connection failed or is silent, the I/O connection failed, the log cannot be written, the driver
  is polled late too often;
- one STOP_MOTION that stops all groups at once, for everything else: an axis off its path,
  impossible feedback (not finite, beyond limits, a jump), emergency stop, teach mode, remote or
  servos off, an alarm, a point that the controller refuses, a wrong, missing or overdue reply, a
  queue that has run out.

Where the motion connection is lost nothing can be sent: the controller's servos brake, and **the
content of its queues is run at the next motion connection**. So that connection is only made once
the robot's status reports no motion.
"""

from dataclasses import dataclass
from pathlib import Path

from unwrinkle.hardware.controller.connections import Connections
from unwrinkle.hardware.controller.finding import FaultCause, Finding
from unwrinkle.hardware.controller.guarded_log import GuardedLog
from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.controller.monitor import Monitor
from unwrinkle.hardware.controller.motion import Motion
from unwrinkle.hardware.controller.preconditions import Preconditions, RobotView
from unwrinkle.hardware.controller_state import (
    CONNECTING,
    FAULT,
    HELD,
    HOLDING,
    OFFLINE,
    READY,
    RUNNING,
    STARTING,
    STOPPING,
    UNKNOWN,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.hardware.motoros.io_channel import IoChannel
from unwrinkle.hardware.motoros.messages import Command, MotionReply, Result, describe
from unwrinkle.hardware.motoros.motion_channel import Asked, MotionChannel
from unwrinkle.hardware.motoros.start_sequence import StartSequence
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.hardware.run_log.protocol import RunLogger
from unwrinkle.hardware.streaming.path_clock import PathClock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.trajectory import Trajectory

#: Instruction where the controller reports motion although no motion connection exists.
QUEUE_LEFT = (
    "the robot moves, or its controller has motion left in its queues, and the next connection to "
    "its motion port would run it: none was made. Keep clear; press HOLD on the pendant or turn "
    "its mode key (MotoROS 1.9.12 then empties the queues), or send a stop as the very first "
    "bytes with --clear-queue"
)
#: Instruction where a motion connection has just ended during motion.
QUEUE_KEPT = (
    "what is in the controller's queues stays there and would be run at the next connection: "
    "press HOLD on the pendant before anything connects again"
)

#: A controller in trajectory mode that was sent nothing for this long is asked for its state, s.
HEARTBEAT_PERIOD_S = 1.0
#: Longest braking along the path; then all groups are stopped at once, s.
LONGEST_BRAKING_S = 10.0
#: Between two attempts to leave trajectory mode, s.
LEAVE_RETRY_S = 0.05
#: Between two attempts to clear an alarm, s.
RESET_RETRY_S = 10.0 * LEAVE_RETRY_S
#: Longest time for leaving trajectory mode, and for clearing an alarm, s.
LONGEST_EXCHANGE_S = 2.0


@dataclass(frozen=True, eq=False)
class _PendingRun:
    """A trajectory that was accepted and waits for trajectory mode.

    Attributes:
        number, name: of the command.
        trajectory: as it will be sent.
        most_override: see `Motion`.
        sequence: brings the controller into trajectory mode.
    """

    number: int
    name: str
    trajectory: Trajectory
    most_override: float
    sequence: StartSequence


class ControllerDriver:
    """Runs trajectories on the robot. Commands return at once; `status` reports their outcome.

    Attributes:
        site: addresses and settings.
        limits: of the axes; a trajectory beyond them is refused.
        status: see `DriverStatus`.
        feedback: newest complete set of joint feedback; None before the first.
    """

    def __init__(
        self,
        site: ControllerSite,
        limits: Limits,
        *,
        log: RunLogger | None = None,
        command: str = "",
        io: bool = True,
        full_speed: Array | None = None,
        lock_directory: Path | None = None,
    ) -> None:
        """Prepare to drive the controller of a site; nothing is connected before `connect`.

        Args:
            site: addresses and settings.
            limits: of the axes; a trajectory beyond them is refused.
            log: records what is sent, measured and decided.
            command: of the owner, shown to another program that finds the robot in use; the command
                line if empty.
            io: whether the controller's inputs and outputs are needed; firmware before MotoROS
                1.6.0 has no port for them.
            full_speed: (13,) rad/s, of which the site's speed cap is a share; the limits' velocity
                if None.
            lock_directory: of the owner's lock file; the user's runtime directory if None.
        """
        self.site = site
        self.limits = limits
        self.status = DriverStatus()
        self.feedback: JointFeedback | None = None
        lock = OwnerLock(site.host, site.motion_port, command, lock_directory)
        self._connections = Connections(site, lock, needs_io=io)
        self._log = GuardedLog(log)
        self._monitor = Monitor(site, limits)
        speed_cap = site.speed_cap * (limits.velocity if full_speed is None else full_speed)
        self._preconditions = Preconditions(site, limits, self._monitor, speed_cap)
        self._robot: RobotStatus | None = None
        self._now = 0.0
        self._polled = False
        self._since = 0.0  # first poll of this connection, s
        self._state = OFFLINE
        self._reason = ""
        self._not_reset = ""  # why a fault could not be reset
        self._command = 0
        self._completed = 0
        self._override = 1.0
        self._pending: _PendingRun | None = None  # while starting
        self._motion: Motion | None = None
        self._rest_since = float("-inf")
        self._leaving_since: float | None = None
        self._next_request = float("-inf")  # of leaving trajectory mode, or of clearing an alarm, s
        self._braking_since: float | None = None  # in a fault
        self._resetting_since: float | None = None

    @property
    def links(self) -> dict[str, TcpLink]:
        """TCP connections by "motion", "state" and "io"; empty while offline.

        The motion connection exists once the robot's status has reported empty queues.
        """
        return self._connections.links

    @property
    def inputs(self) -> dict[int, int | None]:
        """Last values read of inputs, by address; None where unknown."""
        io = self._connections.io
        return {} if io is None else dict(io.inputs)

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Last values that the controller has acknowledged for outputs; None where not answered
        yet, or refused.
        """
        io = self._connections.io
        return {} if io is None else dict(io.written)

    @property
    def io_problem(self) -> str:
        """Last refusal on the I/O connection; empty if there is none."""
        io = self._connections.io
        return "" if io is None else io.problem

    @property
    def braking(self) -> bool:
        """Whether the robot brakes along its path for a fault."""
        return self._braking_since is not None

    # Connection

    def connect(self) -> None:
        """Acquire the owner's lock and connect to the state server, and to the I/O server if it is
        needed.

        The motion connection is made by `poll` once the robot's status has reported that the
        controller's queues are empty, since the controller runs their content as soon as a client
        connects. While connected, nothing changes.

        Raises:
            HardwareError: the robot is in use (by whom), or a server does not answer (host and
                port).
        """
        if self.links:
            return
        self._connections.open()
        self.feedback, self._robot = None, None
        self._pending, self._motion = None, None
        self._braking_since, self._resetting_since = None, None
        self._polled = False
        self._rest_since = float("-inf")
        self._state, self._reason, self._not_reset = CONNECTING, "", ""
        self._publish()

    def close(self) -> None:
        """Leave trajectory mode, disconnect and release the lock; takes about a second at most.

        A robot that still moves is stopped at once: hold it before.
        """
        mode = self._connections.mode_requested
        self._connections.leave(moving=self._moving(self._now), mode=mode)
        if self.links:
            self._event("disconnect", "disconnected")
        self._connections.close()
        self._motion, self._braking_since = None, None
        self._state, self._reason, self._not_reset = OFFLINE, "", ""
        self._publish()

    def abandon(self, text: str) -> None:
        """Stop all groups, close every connection and latch a fault: for a driver that cannot go on
        itself.

        The controller keeps its queues when the motion connection ends, so they are emptied first
        as far as possible; it takes half a second at most.
        """
        self._state, self._reason, self._not_reset = FAULT, text, ""
        self._braking_since = None
        self._connections.leave(moving=self._moving(self._now), mode=False)
        self._connections.abandon(text)
        self._publish()

    # Commands

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot stands; one that cannot be run is refused with a
        reason.

        Args:
            number: counts up with every command; a number seen before changes nothing.
            trajectory: of all thirteen axes, from rest to rest, within the limits as it is sent
                (see `sent_samples`).
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
            channel = self._connections.motion
            assert channel is not None
            earliest = self._rest_since + self.site.pause
            start = StartSequence(self.site, channel, self._connections.in_mode, earliest)
            most = self._preconditions.most_override(sent)
            self._pending = _PendingRun(number, name, sent, most, start)
            self._motion = None
            self._state = STARTING
            self._event("run", f"trajectory {number} {name}".strip(), duration=trajectory.duration)
        self._publish()

    def hold(self, number: int) -> None:
        """Brake along the path to rest: `held`, or `ready` if that is the path's end. At rest it
        completes at once.

        Args:
            number: counts up with every command.
        """
        if number <= self._command:
            return
        self._command = number
        motion = self._motion
        if self._state in (RUNNING, HOLDING) and motion is not None:
            motion.hold_number = number
            self._hold("hold commanded")
        elif self._state == STARTING:
            self._pending, self._state = None, READY
            self._completed, self._reason = number, "hold commanded before the motion began"
        elif self._state in (READY, HELD):
            self._completed = number
        self._publish()

    def resume(self, number: int) -> None:
        """Go on along the path after a hold; the path's end completes this command.

        Args:
            number: counts up with every command.
        """
        if number <= self._command:
            return
        self._command, motion = number, self._motion
        problem = f"there is nothing to resume, the driver is {self._state}"
        if self._state in (HOLDING, HELD) and motion is not None:
            braking = self._state == HOLDING
            problem = self._preconditions.resume(self._view(), motion.stream, braking=braking)
            if not problem:
                motion.number, motion.hold_number, motion.rest_since = number, 0, None
                self._reason = ""
                self._state = RUNNING
                motion.stream.clock.set_rate(self._override)
                self._event("resume", f"resumed by command {number}")
        if problem and self._state != FAULT:
            self._reason = f"resume {number} refused: {problem}"
        self._publish()

    def stop(self, reason: str) -> None:
        """Brake along the path, then leave trajectory mode; the trajectory cannot be resumed."""
        if self._state in (RUNNING, HOLDING, HELD, STARTING, READY):
            if self._state in (RUNNING, HOLDING):
                self._hold(reason)
            elif self._state != HELD:
                self._motion = None
            if self._motion is not None:
                self._motion.rest_since = None
            self._pending = None
            self._state, self._reason, self._leaving_since = STOPPING, reason, None
            self._event("stop", reason)
        self._publish()

    def pause(self, reason: str) -> None:
        """Brake along the path, if a trajectory runs, until a resume: for a watchdog over the
        driver's owner.
        """
        if self._state == RUNNING:
            self._hold(reason)

    def reset(self) -> None:
        """Leave a fault, if the robot is at rest and its status permits; the trajectory cannot be
        resumed.
        """
        if self._state != FAULT:
            return
        problem = self._cannot_reset()
        if problem:
            self._not_reset = problem
        else:
            self._resetting_since = self._now
            self._next_request = float("-inf")
        self._publish()

    def set_override(self, value: float) -> None:
        """Run at a share of the planned speed, 0 to 1, from now on; another value is refused and
        changes nothing.

        Shares just below 1 are run at `path_clock.HIGHEST_REDUCED_RATE`.
        """
        if not 0.0 <= value <= 1.0:
            if self._state != FAULT:
                self._reason = f"speed override {value} refused: give 0 to 1"
            self._publish()
            return
        motion = self._motion
        under_way = self._state in (RUNNING, HOLDING, HELD)
        if under_way and motion is not None and not value <= motion.most_override:
            self._reason = (
                f"speed override {value:g} refused: the controller's speed governor allows "
                f"{motion.most_override:.3f} of this trajectory's speed"
            )
            self._publish()
            return
        changed = value != self._override
        self._override = float(value)
        if self._state == RUNNING and motion is not None:
            motion.stream.clock.set_rate(self._override)
        if changed:
            self._event("override", f"speed override {value:g}", value=float(value))
        self._publish()

    def fail(self, text: str) -> None:
        """Stop at once and latch a fault, for a failure outside the driver."""
        self._fault(Finding(FaultCause.ERROR, text))
        self._publish()

    def write_output(self, address: int, value: int) -> None:
        """Set a digital output to 0 or 1; `outputs_written` shows when it is done.

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

    # One poll

    def poll(self, now: float) -> None:
        """Read what came, check it, and send what is due; never blocks.

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
        moving = self._moving(now)
        new = self._read(now)
        self._take_answers(now)
        self._judge(now, gap, moving, new)
        self._step(now)
        self._publish()

    def _read(self, now: float) -> bool:
        """Read the state and I/O connections; return whether a new set of feedback came."""
        new = False
        reader = self._connections.state
        if reader is not None:
            last = reader.feedback
            before = reader.statuses
            try:
                sets = reader.poll(now)
            except HardwareError as error:
                self._connections.give_up_state(str(error))
                self._fault(Finding(FaultCause.STATE, str(error), brake=True))
                sets = []
            for feedback in sets:
                finding = self._monitor.plausible(feedback, last)
                self._log.measured(now, feedback)
                if finding is not None:
                    self._fault(finding)
                    break
                self.feedback = last = feedback
                new = True
            if self._connections.state is not None and reader.statuses != before:
                self._robot = reader.status
        io = self._connections.io
        if io is not None:
            try:
                io.poll(now)
            except HardwareError as error:
                self._connections.give_up_io(str(error))
                self._fault(Finding(FaultCause.IO, str(error), brake=True))
        return new

    def _take_answers(self, now: float) -> None:
        self._connections.poll(now)
        channel = self._connections.motion
        if channel is None:
            return
        try:
            answers = channel.poll(now)
        except HardwareError as error:
            self._motion_lost(channel, str(error), now)
            return
        for asked, reply in answers:
            self._answered(asked, reply, now)

    def _answered(self, asked: Asked, reply: MotionReply, now: float) -> None:
        success = reply.result == Result.SUCCESS
        if asked.what == Command.START_TRAJ_MODE:
            self._connections.in_mode = success and self._state != FAULT
        elif asked.what == Command.STOP_TRAJ_MODE and success:
            self._connections.in_mode = False
        elif asked.what == Command.CHECK_MOTION_READY and not success:
            self._connections.in_mode = False
            if self._state == HELD:
                text = describe(Result.NOT_READY, reply.subcode)
                text = f"the robot was made unready while it was held: {text}"
                self._fault(Finding(FaultCause.ROBOT, text))
        if self._pending is not None:
            self._pending.sequence.answered(asked, reply, now)
        if self._motion is not None:
            self._motion.stream.answered(asked, reply, now)

    def _judge(self, now: float, gap: float, moving: bool, new: bool) -> None:
        """Latch a fault, or hold, for what was read and for the time since the last poll."""
        monitor, motion, feedback = self._monitor, self._motion, self.feedback
        if late := monitor.polled(gap, moving):
            self._fault(late)
        if self._log.problem and self._state != FAULT:
            self._fault(Finding(FaultCause.LOG, self._log.problem, brake=True))
        age = self._age(now)
        if age > self.site.fault_after and self._state != CONNECTING:
            text = f"feedback is {age:.2f} s old, at most {self.site.fault_after:g} s"
            self._fault(Finding(FaultCause.FEEDBACK, text, brake=True))
        if motion is None:
            return
        if motion.stream.problem:
            self._fault(Finding(FaultCause.STREAM, motion.stream.problem))
        elif empty := motion.stream.ran_out(now):
            text = f"{empty} (last poll {1e3 * gap:.0f} ms ago)"
            self._fault(Finding(FaultCause.LATE, text))
        watched = self._state in (RUNNING, HOLDING, HELD, STOPPING)
        if not watched and self._braking_since is None:
            return
        if new and feedback is not None and (off := monitor.follows(feedback, motion.stream)):
            self._fault(off)
        robot = self._robot
        motion.was_possible |= robot is not None and robot.motion_possible == 1
        if wrong := monitor.robot(robot, motion.was_possible):
            self._fault(wrong)
        if age > self.site.hold_after and self._state == RUNNING:
            self._hold(f"feedback is {age:.2f} s old, at most {self.site.hold_after:g} s")

    def _step(self, now: float) -> None:
        """Do what the state requires, and send the next request."""
        state, motion = self._state, self._motion
        if state == CONNECTING:
            self._connecting(now)
        elif state == STARTING:
            self._starting(now)
        elif state == STOPPING:
            self._stopping(now)
        elif state == FAULT:
            self._faulted(now)
        elif motion is not None:
            motion.stream.poll(now)
            if state == RUNNING:
                self._running(now, motion)
            elif state == HOLDING:
                self._holding(now, motion)
        channel = self._connections.motion
        if channel is not None:
            channel.send_next(now)
        if (
            self._connections.in_mode
            and channel is not None
            and channel.quiet
            and now - channel.used > HEARTBEAT_PERIOD_S
            and self._state in (READY, HELD, RUNNING)
        ):
            channel.control(Command.CHECK_MOTION_READY, now)

    # The states

    def _connecting(self, now: float) -> None:
        robot, reader = self._robot, self._connections.state
        known = robot is not None and UNKNOWN not in (
            robot.drives_powered,
            robot.e_stopped,
            robot.in_error,
            robot.in_motion,
            robot.mode,
        )
        if self.feedback is not None and known and robot is not None and robot.in_motion == 0:
            try:
                self._connections.open_motion()
            except HardwareError as error:
                self._fault(Finding(FaultCause.CONNECT, str(error)))
                return
            self._state = READY
            self._event("ready", "feedback and status are whole, and nothing is in the queues")
        elif now - self._since > self.site.connect_timeout:
            missing = "" if reader is None else reader.missing
            text = "the robot's status says 'unknown'" if robot else "no status has come"
            if self.feedback is None:
                text = (
                    f"no feedback has come of groups {missing}; compare the site's groups and "
                    "profile with the controller's"
                )
            elif known:
                self._fault(Finding(FaultCause.QUEUE, QUEUE_LEFT))
                return
            text = f"after {now - self._since:.1f} s {text}"
            self._fault(Finding(FaultCause.HANDSHAKE, text))

    def _starting(self, now: float) -> None:
        pending, channel = self._pending, self._connections.motion
        assert pending is not None and channel is not None
        start = pending.sequence
        if not self._connections.mode_requested and now >= self._rest_since + self.site.pause:
            self._connections.mode_requested = True
        start.poll(now)
        problem = start.problem
        if start.done and not problem:
            problem = self._preconditions.start(self._view(), pending.trajectory)
        if not problem and not start.done:
            return
        self._pending = None
        self._state = READY
        if problem:
            self._refuse(pending.number, pending.name, problem)
            return
        limits = StreamLimits.of(self.limits)
        clock = PathClock(pending.trajectory, limits, rate=self._override)
        number = pending.number

        def record(now: float, sequence: int, time: float, q: Array, v: Array) -> None:
            self._log.commanded(now, number, sequence, time, q, v)

        stream = PointStream(clock, self.site, channel, record)
        self._motion = Motion(self.site, stream, number, pending.most_override)
        self._monitor.restart()
        self._state = RUNNING
        stream.poll(now)

    def _running(self, now: float, motion: Motion) -> None:
        if not motion.stream.ended(now):
            return
        if self._arrived(now, motion):
            self._state, self._completed = READY, max(self._completed, motion.number)
            self._rest_since = now
            self._event("completed", f"the trajectory of command {motion.number} is done")

    def _holding(self, now: float, motion: Motion) -> None:
        if motion.stream.at_rest(now) and self._arrived(now, motion):
            done = motion.stream.clock.done
            self._state = READY if done else HELD
            self._completed = max(self._completed, motion.hold_number)
            if done:  # the hold came at the path's end
                self._completed = max(self._completed, motion.number)
                self._reason = ""
            self._rest_since = now
            text = f"at rest {motion.stream.progress(now):.3f} s along the trajectory"
            self._event("held", text)

    def _stopping(self, now: float) -> None:
        """Come to rest, then leave trajectory mode; refused while queues are not empty, so the
        request is repeated.
        """
        motion, channel = self._motion, self._connections.motion
        if motion is not None:
            motion.stream.poll(now)
            if not motion.stream.at_rest(now) or not self._arrived(now, motion):
                return
        if self._leaving_since is None:
            self._leaving_since = now
        if channel is not None and not channel.quiet:
            return  # trajectory mode may be being started
        if not self._connections.in_mode or channel is None:
            self._motion, self._state = None, READY
            self._rest_since = now
        elif now - self._leaving_since > LONGEST_EXCHANGE_S:
            text = f"trajectory mode could not be left within {LONGEST_EXCHANGE_S:g} s"
            self._fault(Finding(FaultCause.LEAVE, text))
        elif now >= self._next_request:
            channel.control(Command.STOP_TRAJ_MODE, now)
            self._next_request = now + LEAVE_RETRY_S

    def _faulted(self, now: float) -> None:
        """Brake along the path to rest; continue a reset."""
        motion = self._motion
        if self._braking_since is not None and motion is not None:
            motion.stream.poll(now)
            if motion.stream.at_rest(now):
                self._braking_since = None
                self._event("rest", "at rest after braking along the path")
            elif now - self._braking_since > LONGEST_BRAKING_S:
                text = f"no rest after {LONGEST_BRAKING_S:g} s of braking"
                self._fault(Finding(FaultCause.BRAKE, text))
        if self._resetting_since is not None:
            self._reset_on(now, self._resetting_since)

    def _reset_on(self, now: float, since: float) -> None:
        """Clear the controller's alarm, if it shows one; then leave the fault."""
        robot, channel = self._robot, self._connections.motion
        if channel is None or robot is None:
            self._resetting_since = None
        elif robot.in_error != 1:
            self._resetting_since, self._motion, self._pending = None, None, None
            self._state, self._reason, self._not_reset = READY, "", ""
            self._rest_since = now
            self._event("reset", "the fault was reset; a new trajectory is needed")
        elif now - since > LONGEST_EXCHANGE_S:
            self._resetting_since = None
            self._not_reset = robot.problem
        elif channel.quiet and now >= self._next_request:
            self._next_request = now + RESET_RETRY_S
            channel.control(Command.RESET_ALARM, now)

    def _hold(self, reason: str) -> None:
        """Begin to brake along the path."""
        motion = self._motion
        assert motion is not None
        if self._state == RUNNING:
            motion.rest_since = None
            self._event("hold", reason)
        self._state, self._reason = HOLDING, reason
        motion.stream.clock.set_rate(0.0)

    def _arrived(self, now: float, motion: Motion) -> bool:
        """Return whether the robot is at rest at the last point sent; latch a fault if it should
        have been.
        """
        assert self.feedback is not None
        if motion.arrived(now, self.feedback):
            return True
        if overdue := motion.arrival_overdue(now, self.feedback):
            self._fault(overdue)
        return False

    # Faults

    def _fault(self, finding: Finding) -> None:
        """Latch a fault; brake along the path if possible, else stop all groups at once."""
        if self._state == OFFLINE:
            return
        latched = self._state == FAULT
        if not latched:
            self._state, self._reason, self._not_reset = FAULT, finding.text, ""
            self._connections.in_mode = False
            self._event("fault", finding.text, cause=finding.kind, braking=finding.brake)
        elif self._braking_since is None or finding.brake:
            return  # stopped, or braking as well as it can
        motion, channel = self._motion, self._connections.motion
        if finding.brake and not self._moving(self._now):
            return
        reachable = channel is not None and channel.open and not latched
        if finding.brake and reachable and motion is not None and not motion.stream.problem:
            self._braking_since = self._now
            motion.stream.clock.set_rate(0.0)
            return
        self._braking_since = None
        if self._connections.stop_motion(self._now):
            if motion is not None:
                motion.stream.stop()
            self._event("stop", "all groups stopped at once")

    def _motion_lost(self, channel: MotionChannel, text: str, now: float) -> None:
        """Latch a fault for a failed motion connection; stop all groups before it is closed, if it
        is still open.
        """
        moving = self._moving(now)
        if self._motion is not None:
            self._motion.stream.stop()
        if self._connections.give_up_motion(channel, text, now):
            self._event("stop", "all groups stopped at once, then the motion connection is closed")
            if moving:
                text = (
                    f"{text}; a stop of all groups is sent before the connection is closed, "
                    "whether it is carried out is not known: `unwrinkle site check` tells whether "
                    "motion is left in the queues"
                )
        else:
            if moving and self._state == FAULT:
                self._reason = f"{self._reason}; {QUEUE_KEPT}"
            text = f"{text}; {QUEUE_KEPT}" if moving else text
        self._fault(Finding(FaultCause.MOTION, text))

    # Reasons for refusals; empty if there is none

    def _cannot_run(self, trajectory: Trajectory) -> str:
        if self._state == FAULT:
            return f"the driver is in fault ({self._status_reason()}); reset it and plan anew"
        if self._state not in (READY, HELD):
            return f"the driver is {self._state}; wait until it is ready"
        check, view = self._preconditions, self._view()
        return check.trajectory(trajectory, self._override) or check.start(view, trajectory)

    def _cannot_reset(self) -> str:
        connections = self._connections
        lost = connections.state is None or connections.motion is None
        if lost or (connections.needs_io and connections.io is None):
            return "a connection is lost; close the driver and connect again"
        if self._log.problem:
            return self._log.problem
        if self._braking_since is not None:
            return "the robot is still braking"
        return self._preconditions.reset(self._view())

    def _connected_io(self) -> IoChannel:
        io = self._connections.io
        if io is None:
            raise HardwareError(
                f"no I/O connection to {self.site.host}:{self.site.io_port}; connect first"
            )
        return io

    def _refuse(self, number: int, name: str, problem: str) -> None:
        label = f"trajectory {number}" + (f" ({name})" if name else "")
        text = f"{label} refused: {problem}"
        if self._state != FAULT:
            self._reason = text
        self._event("refused", text)

    # Report

    def _moving(self, now: float) -> bool:
        """Return whether motion that was sent has not been run to rest."""
        return self._motion is not None and not self._motion.stream.at_rest(now)

    def _age(self, now: float) -> float:
        """Return the age of the feedback, s; infinite before the first."""
        return float("inf") if self.feedback is None else now - self.feedback.received

    def _view(self) -> RobotView:
        return RobotView(self._robot, self.feedback, self._age(self._now))

    def _event(self, kind: str, text: str, **data: object) -> None:
        self._log.event(self._now, kind, text, **data)

    def _status_reason(self) -> str:
        """Return the reason for the status, with why a fault could not be reset."""
        return f"{self._reason} [not reset: {self._not_reset}]" if self._not_reset else self._reason

    def _publish(self) -> None:
        now = self._now
        stream = None if self._motion is None else self._motion.stream
        self.status = DriverStatus(
            state=self._state,
            command=self._command,
            completed=self._completed,
            progress=0.0 if stream is None else stream.progress(now),
            reason=self._status_reason(),
            override=self._override,
            robot=self._robot,
            feedback_age=self._age(now),
            late=self._monitor.late,
            points=0 if stream is None else stream.acknowledged,
            following_error=self._monitor.following_error,
            lag=self._monitor.lag,
        )
        self._log.status(now, self.status)
