"""What the controller's driver does whatever its state: connections, feedback, the log, and how it stops for a fault."""

from collections.abc import Callable
from pathlib import Path

from unwrinkle.hardware.controller.feedback import FeedbackReader
from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.controller.monitor import Finding, Monitor
from unwrinkle.hardware.controller_state import (
    CONNECTING,
    FAULT,
    OFFLINE,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.hardware.motoros.io_channel import IoChannel
from unwrinkle.hardware.motoros.link import TcpLink
from unwrinkle.hardware.motoros.motion_channel import MotionChannel, StopAndPart, stop_and_leave
from unwrinkle.hardware.run_log.protocol import NoLog, RunLogger
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

#: What has to be done about a controller whose queues are not empty although nobody is connected.
QUEUE_LEFT = (
    "the robot moves, or its controller has motion left in its queues, and the next connection to its motion port would "
    "run it: none was made. Keep clear; press HOLD on the pendant or turn its mode key (MotoROS 1.9.12 then empties the "
    "queues), or send a stop as the very first bytes with --clear-queue"
)
#: The same, where a motion connection has just ended in motion.
QUEUE_KEPT = (
    "what is in the controller's queues stays there and would be run at the next connection: press HOLD on the pendant "
    "before anything connects again"
)


class DriverCore:
    """Base of the driver.

    Attributes:
        status: see `DriverStatus`.
        feedback: the newest whole set; None before the first.
        links: the connections, by "motion", "state" and "io"; empty while offline. That of motion is made once the
            robot's status has said that nothing is left in the queues.
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
        """Drive the controller of a site.

        Args:
            site: addresses and settings.
            limits: of the axes; a trajectory beyond them is refused.
            log: takes down what happens.
            command: of the owner, told to whoever finds the robot in use; the command line if empty.
            io: whether the controller's inputs and outputs are needed; firmware before MotoROS 1.6.0 has no port for them.
            full_speed: (13,) of the axes, rad/s, that the site's speed cap is a share of; the limits' if left out.
            lock_directory: of the owner's lock; the user's runtime directory if left out.
        """
        self.site = site
        self.limits = limits
        self.status = DriverStatus()
        self.feedback: JointFeedback | None = None
        self.links: dict[str, TcpLink] = {}
        self._log: RunLogger = log or NoLog()
        self._log_problem = ""
        self._lock = OwnerLock(site.host, site.motion_port, command, lock_directory)
        self._monitor = Monitor(site, limits)
        self._reader: FeedbackReader | None = None
        self._channel: MotionChannel | None = None
        self._io: IoChannel | None = None
        self._needs_io = io
        self._cap = site.speed_cap * (limits.velocity if full_speed is None else full_speed)
        self._most_override = 1.0  # that keeps the running trajectory below the cap
        self._parting: StopAndPart | None = None  # of a motion connection that has failed
        self._now = 0.0
        self._polled = False
        self._since = 0.0  # the first poll of this connection
        self._robot: RobotStatus | None = None
        self._state = OFFLINE
        self._reason = ""
        self._command = self._completed = 0
        self._number = self._path_number = self._hold_number = 0  # that end completes; of the path
        self._override = 1.0
        self._stream: PointStream | None = None
        self._braking: float | None = None  # since when, in a fault
        self._mode_asked = False  # trajectory mode was asked for over this connection
        self._in_mode = False
        self._rest_since = float("-inf")
        self._published: tuple[object, ...] = ()

    @property
    def inputs(self) -> dict[int, int | None]:
        """Last values read of inputs, by address; None where unknown."""
        return {} if self._io is None else dict(self._io.inputs)

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Last values that the controller has taken for outputs; None where not answered yet, or refused."""
        return {} if self._io is None else dict(self._io.written)

    @property
    def io_problem(self) -> str:
        """What the I/O connection refused last; empty if nothing."""
        return "" if self._io is None else self._io.problem

    # Connections

    def connect(self) -> None:
        """Take the owner's lock and connect to the state server, and to inputs and outputs if they are needed.

        The motion connection follows while it is polled, once the robot's status has said that nothing is left in the
        controller's queues: it would be run as soon as somebody connects. Connected, it changes nothing.

        Raises:
            HardwareError: the robot is in use (by whom), or nobody answers (host and port).
        """
        if self.links:
            return
        self._lock.acquire()
        try:
            self.links["state"] = self._link("state", self.site.state_port)
            if self._needs_io:
                self.links["io"] = self._link("io", self.site.io_port)
        except HardwareError:
            self._disconnect()
            raise
        self._reader = FeedbackReader(self.links["state"], self.site)
        if self._needs_io:
            self._io = IoChannel(self.links["io"], self.site.reply_timeout)
        self.feedback, self._robot = None, None
        self._stream, self._braking = None, None
        self._mode_asked = self._in_mode = self._polled = False
        self._rest_since = float("-inf")
        self._state, self._reason = CONNECTING, ""
        self._publish()

    def _link(self, name: str, port: int) -> TcpLink:
        site = self.site
        label = f"controller's {name} server"
        return TcpLink.connect(site.host, port, site.connect_timeout, label)

    def _connect_motion(self) -> None:
        """Make the motion connection.

        Raises:
            HardwareError: nobody answers.
        """
        link = self._link("motion", self.site.motion_port)
        self.links["motion"] = link
        self._channel = MotionChannel(link, self.site.reply_timeout)

    def close(self) -> None:
        """Leave trajectory mode, disconnect and give the lock back; takes at most about a second.

        What still moves is stopped at once: hold before.
        """
        self._leave(mode=self._mode_asked)
        if self.links:
            self._event("disconnect", "disconnected")
        self._disconnect()
        self._state, self._reason = OFFLINE, ""
        self._publish()

    def _leave(self, *, mode: bool) -> None:
        """Empty the queues if something may be in them, and leave trajectory mode; bounded in time."""
        link = self.links.get("motion")
        if link is None or link.closed or not self._mode_asked:
            return
        stream, channel = self._stream, self._channel
        moving = stream is not None and not stream.at_rest(self._now)
        waiting = channel is None or not channel.quiet
        # A channel that was given up has sent its stop, or was about to.
        moving = moving or channel is None or not mode
        stop_and_leave(link, waiting=waiting, moving=moving, mode=mode)

    def _disconnect(self) -> None:
        for link in self.links.values():
            link.close()
        self.links.clear()
        self._reader, self._channel, self._io = None, None, None
        self._parting = None
        self._stream, self._braking = None, None
        self._in_mode = self._mode_asked = False
        self._lock.release()

    # Faults

    def fail(self, text: str) -> None:
        """Stop at once and latch a fault: for whatever goes wrong around the driver."""
        self._fault(Finding("error", text))
        self._publish()

    def abandon(self, text: str) -> None:
        """Stop all groups, close every connection and latch a fault: where the driver itself cannot go on.

        The controller keeps what is in its queues when the motion connection ends, so they are emptied first, as far as
        that can still be done; it takes at most half a second.
        """
        self._state, self._reason, self._braking = FAULT, text, None
        self._leave(mode=False)
        for link in self.links.values():
            link.close(text)
        self._reader, self._channel, self._io = None, None, None
        self._parting = None
        self._publish()

    @property
    def braking(self) -> bool:
        """Whether it brakes along the path in a fault."""
        return self._braking is not None

    def _fault(self, finding: Finding) -> None:
        """Latch a fault; brake along the path where that can be done, else stop all groups at once."""
        if self._state == OFFLINE:
            return
        latched = self._state == FAULT
        if not latched:
            self._state, self._reason = FAULT, finding.text
            self._in_mode = False
            self._event("fault", finding.text, cause=finding.kind, braking=finding.brake)
        elif self._braking is None or finding.brake:
            return  # stopped, or braking as well as it can
        stream, channel = self._stream, self._channel
        resting = stream is None or stream.at_rest(self._now)
        if finding.brake and resting:
            return
        can = channel is not None and channel.open and not latched
        if finding.brake and can and stream is not None and not stream.problem:
            self._braking = self._now
            stream.clock.set_rate(0.0)
            return
        self._braking = None
        self._stop_motion()

    def _stop_motion(self) -> None:
        """One command that empties the queues of all groups."""
        channel = self._channel
        if channel is None or not channel.open or not self._mode_asked:
            return
        channel.stop(self._now)
        if self._stream is not None:
            self._stream.stop()
        self._event("stop", "all groups stopped at once")

    # What comes

    def _read(self, now: float) -> bool:
        """Read the state and I/O connections; whether a new set of feedback came."""
        new = False
        if self._reader is not None:
            last = self._reader.feedback
            before = self._reader.statuses
            try:
                sets = self._reader.poll(now)
            except HardwareError as error:
                self.links["state"].close(str(error))
                self._reader = None
                self._fault(Finding("state", str(error), brake=True))
                sets = []
            for feedback in sets:
                finding = self._monitor.plausible(feedback, last)
                self._logged(self._log.measured, now, feedback)
                if finding is not None:
                    self._fault(finding)
                    break
                self.feedback = last = feedback
                new = True
            if self._reader is not None and self._reader.statuses != before:
                self._robot = self._reader.status
        if self._io is not None:
            try:
                self._io.poll(now)
            except HardwareError as error:
                self.links["io"].close(str(error))
                self._io = None
                self._fault(Finding("io", str(error), brake=True))
        return new

    def _age(self, now: float) -> float:
        return float("inf") if self.feedback is None else now - self.feedback.received

    # What is told

    def _logged(self, write: Callable[..., None], *values: object, **data: object) -> None:
        """Write to the log; one that cannot be written is a fault, once, and is left alone from then on."""
        if self._log_problem:
            return
        try:
            write(*values, **data)
        except OSError as error:
            self._log_problem = (
                f"the log cannot be written: {error.strerror or error}; is its disk full?"
            )

    def _event(self, kind: str, text: str, **data: object) -> None:
        self._logged(self._log.event, self._now, kind, text, **data)

    def _record(self, now: float, sequence: int, time: float, q: Array, v: Array) -> None:
        self._logged(self._log.commanded, now, self._path_number, sequence, time, q, v)

    def _publish(self) -> None:
        now, stream = self._now, self._stream
        self.status = DriverStatus(
            self._state,
            self._command,
            self._completed,
            0.0 if stream is None else stream.progress(now),
            self._reason,
            self._override,
            self._robot,
            self._age(now),
            self._monitor.late,
            0 if stream is None else stream.acknowledged,
            self._monitor.following_error,
            self._monitor.lag,
        )
        key = (self._state, self._command, self._completed, self._reason, self._override)
        if (*key, self._robot) != self._published:
            self._published = (*key, self._robot)
            self._logged(self._log.status, now, self.status)
