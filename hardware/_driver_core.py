"""What the controller's driver does whatever its state: connections, feedback, the log, and how it stops for a fault."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware._feedback import FeedbackReader
from unwrinkle.hardware._io_channel import IoChannel
from unwrinkle.hardware._motion_channel import ALL_GROUPS, MotionChannel
from unwrinkle.hardware.link import TcpLink
from unwrinkle.hardware.lock import OwnerLock
from unwrinkle.hardware.logging_ports import NoLog, RunLogger
from unwrinkle.hardware.monitor import Finding, Monitor
from unwrinkle.hardware.streaming import PointStream
from unwrinkle.hardware.values import (
    CONNECTING,
    FAULT,
    OFFLINE,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.hardware.wire import Command, MotionControl
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

Array = NDArray[np.float64]

#: Longest time that leaving takes for each thing it sends, s.
_LEAVING = 0.25


class DriverCore:
    """Base of the driver.

    Attributes:
        status: see `DriverStatus`.
        feedback: the newest whole set; None before the first.
        links: the connections, by "motion", "state" and "io"; empty while offline.
    """

    def __init__(
        self,
        site: ControllerSite,
        limits: Limits,
        *,
        log: RunLogger | None = None,
        command: str = "",
        lock_directory: Path | None = None,
    ) -> None:
        """Drive the controller of a site.

        Args:
            site: addresses and settings.
            limits: of the axes; a trajectory beyond them is refused.
            log: takes down what happens.
            command: of the owner, told to whoever finds the robot in use; the command line if empty.
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
        """Take the owner's lock and open the three connections; nothing is sent. Connected, it changes nothing.

        Raises:
            HardwareError: the robot is in use (by whom), or nobody answers (host and port).
        """
        if self.links:
            return
        site = self.site
        self._lock.acquire()
        try:
            for name, port in (
                ("state", site.state_port),
                ("motion", site.motion_port),
                ("io", site.io_port),
            ):
                self.links[name] = TcpLink.connect(
                    site.host, port, site.connect_timeout, f"controller's {name} server"
                )
        except HardwareError:
            self._disconnect()
            raise
        self._reader = FeedbackReader(self.links["state"], site)
        self._channel = MotionChannel(self.links["motion"], site.reply_timeout)
        self._io = IoChannel(self.links["io"], site.reply_timeout)
        self.feedback, self._robot = None, None
        self._stream, self._braking = None, None
        self._mode_asked = self._in_mode = self._polled = False
        self._rest_since = float("-inf")
        self._state, self._reason = CONNECTING, ""
        self._publish()

    def close(self) -> None:
        """Leave trajectory mode, disconnect and give the lock back; takes at most about a second.

        What still moves is stopped at once: hold before.
        """
        link = self.links.get("motion")
        if link is not None and not link.closed and self._mode_asked:
            moving = self._stream is not None and not self._stream.at_rest(self._now)
            commands = [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
            for command in [Command.STOP_MOTION, *commands] if moving else commands:
                link.send(MotionControl(ALL_GROUPS, 0, command).to_message().encode())
            link.drain(_LEAVING)
            # Answers that find nobody would make the controller's system drop what was sent; it closes in the end.
            end = time.monotonic() + _LEAVING
            while not link.closed and (left := end - time.monotonic()) > 0.0:
                if link.wait(left):
                    link.receive()
        if self.links:
            self._event("disconnect", "disconnected")
        self._disconnect()
        self._state, self._reason = OFFLINE, ""
        self._publish()

    def _disconnect(self) -> None:
        for link in self.links.values():
            link.close()
        self.links.clear()
        self._reader, self._channel, self._io = None, None, None
        self._stream, self._braking = None, None
        self._in_mode = self._mode_asked = False
        self._lock.release()

    # Faults

    def fail(self, text: str) -> None:
        """Stop at once and latch a fault: for whatever goes wrong around the driver."""
        self._fault(Finding("error", text))
        self._publish()

    def abandon(self, text: str) -> None:
        """Close every connection at once and latch a fault: where the driver itself cannot go on.

        The controller empties its queues when the motion connection ends, and its servos brake.
        """
        self._state, self._reason, self._braking = FAULT, text, None
        for link in self.links.values():
            link.close(text)
        self._reader, self._channel, self._io = None, None, None
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
        channel.control(Command.STOP_MOTION, self._now)
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
