"""The connections to the robot controller: made in a safe order, ended without leaving motion in
its queues.

The controller keeps the content of its queues when the motion connection ends, and runs it when the
next one is accepted. So the motion connection is the last one to be made, and a stop of all groups
is sent before it is closed.
"""

from unwrinkle.hardware.controller.feedback import FeedbackReader
from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.motoros.io_channel import IoChannel
from unwrinkle.hardware.motoros.motion_channel import MotionChannel, StopAndClose, stop_and_leave
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import ControllerSite


class Connections:
    """The owner's lock, and the connections for state, inputs and outputs, and motion.

    Attributes:
        links: TCP connections by "state", "io" and "motion"; empty while disconnected.
        state: reader of the state connection; None while there is none, or after it has failed.
        io: channel of inputs and outputs; None while there is none, or after it has failed.
        motion: channel of the motion connection; None before `open_motion`, or after it has failed.
        needs_io: whether the connection for inputs and outputs is made.
        mode_requested: trajectory mode was requested over this motion connection, so that motion
            may be queued.
        in_mode: the controller has confirmed trajectory mode.
    """

    def __init__(self, site: ControllerSite, lock: OwnerLock, *, needs_io: bool) -> None:
        """Prepare; nothing is connected before `open`."""
        self._site = site
        self._lock = lock
        self._stopping: StopAndClose | None = None  # of a motion connection that has failed
        self.links: dict[str, TcpLink] = {}
        self.state: FeedbackReader | None = None
        self.io: IoChannel | None = None
        self.motion: MotionChannel | None = None
        self.needs_io = needs_io
        self.mode_requested = False
        self.in_mode = False

    def open(self) -> None:
        """Acquire the owner's lock and connect to the state server, and to the I/O server if it is
        needed.

        Raises:
            HardwareError: the robot is in use, or a server does not answer; then nothing stays
                connected.
        """
        self._lock.acquire()
        try:
            self.links["state"] = self._connect("state", self._site.state_port)
            if self.needs_io:
                self.links["io"] = self._connect("io", self._site.io_port)
        except HardwareError:
            self.close()
            raise
        self.state = FeedbackReader(self.links["state"], self._site)
        if self.needs_io:
            self.io = IoChannel(self.links["io"], self._site.reply_timeout)
        self.mode_requested = self.in_mode = False

    def open_motion(self) -> None:
        """Connect to the motion server, which makes the controller run what its queues hold.

        Raises:
            HardwareError: the server does not answer.
        """
        link = self._connect("motion", self._site.motion_port)
        self.links["motion"] = link
        self.motion = MotionChannel(link, self._site.reply_timeout)

    def stop_motion(self, now: float) -> bool:
        """Send STOP_MOTION to all groups, if motion may be queued and can be reached; return
        whether it is sent.
        """
        if self.motion is None or not self.motion.open or not self.mode_requested:
            return False
        self.motion.stop(now)
        return True

    def give_up_motion(self, channel: MotionChannel, reason: str, now: float) -> bool:
        """End a motion connection whose replies cannot be trusted any more.

        Returns:
            True if a stop of all groups is sent first (`poll` closes the connection), False if it
                is closed now.
        """
        self.motion = None
        if channel.open and self.mode_requested:
            self._stopping = StopAndClose(self.links["motion"], now, waiting=not channel.quiet)
            return True
        self.links["motion"].close(reason)
        return False

    def give_up_state(self, reason: str) -> None:
        """Close the state connection after it has failed."""
        self.links["state"].close(reason)
        self.state = None

    def give_up_io(self, reason: str) -> None:
        """Close the connection for inputs and outputs after it has failed."""
        self.links["io"].close(reason)
        self.io = None

    def poll(self, now: float) -> None:
        """Continue the stop before a motion connection that has failed is closed."""
        if self._stopping is not None and self._stopping.poll(now):
            self._stopping = None

    def leave(self, *, moving: bool, mode: bool) -> None:
        """Empty the queues if motion may be in them, and leave trajectory mode; blocks for about a
        second at most.

        Args:
            moving: motion that was sent has not been run to rest.
            mode: leave trajectory mode; otherwise the queues are emptied in any case.
        """
        link = self.links.get("motion")
        if link is None or link.closed or not self.mode_requested:
            return
        waiting = self.motion is None or not self.motion.quiet
        # A channel that was given up has sent its stop, or was about to.
        moving = moving or self.motion is None or not mode
        stop_and_leave(link, waiting=waiting, moving=moving, mode=mode)

    def abandon(self, reason: str) -> None:
        """Close every connection; the lock is kept until `close`."""
        for link in self.links.values():
            link.close(reason)
        self._forget()

    def close(self) -> None:
        """Close every connection and release the lock."""
        for link in self.links.values():
            link.close()
        self.links.clear()
        self._forget()
        self.in_mode = self.mode_requested = False
        self._lock.release()

    def _forget(self) -> None:
        self.state, self.io, self.motion = None, None, None
        self._stopping = None

    def _connect(self, name: str, port: int) -> TcpLink:
        site = self._site
        return TcpLink.connect(site.host, port, site.connect_timeout, f"controller's {name} server")
