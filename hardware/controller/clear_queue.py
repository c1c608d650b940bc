"""Emptying of the queues that a lost motion connection has left in the controller: a stop as the
very first bytes.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.controller.feedback import FeedbackReader
from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.controller_state import RobotStatus
from unwrinkle.hardware.motoros.messages import Result
from unwrinkle.hardware.motoros.motion_channel import LEAVE_TIMEOUT_S, request_stop
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import ControllerSite

#: Longest time to rest after the stop, s.
_LONGEST_REST_S = 3.0


@dataclass(frozen=True)
class QueueCleared:
    """Result of emptying the queues.

    Attributes:
        needed: whether motion was queued, or the robot moved.
        moved: greatest motion of an axis meanwhile, rad.
    """

    needed: bool
    moved: float

    @property
    def text(self) -> str:
        """Sentence for the user."""
        if not self.needed:
            return "nothing is left in the controller's queues; nothing was sent"
        return (
            "the controller's queues are empty; the axes moved by "
            f"{1e3 * self.moved:.2f} mrad at most"
        )


def clear_queue(
    site: ControllerSite,
    clock: Callable[[], float] = time.monotonic,
    *,
    command: str = "unwrinkle --clear-queue",
) -> QueueCleared:
    """Send STOP_MOTION as the first bytes of a motion connection, if the robot's status reports
    motion in the queues.

    The controller runs its queues from the moment it accepts the connection, so one interpolation
    period of motion may precede the stop: ask the operator first.

    Args:
        site: of the controller.
        clock: monotonic, s.
        command: of the owner's lock.

    Raises:
        HardwareError: another program drives the robot, a server does not answer, or the stop was
            refused or had no effect.
    """
    lock = OwnerLock(site.host, site.motion_port, command)
    lock.acquire()
    state: TcpLink | None = None
    try:
        state = TcpLink.connect(
            site.host, site.state_port, site.connect_timeout, "controller's state server"
        )
        reader = FeedbackReader(state, site)
        if _await(reader, state, clock, site.connect_timeout).in_motion == 0:
            return QueueCleared(False, 0.0)
        if reader.feedback is None:
            raise HardwareError("no joint feedback has come; the queues are left as they are")
        before = reader.feedback.positions
        _stop(site)
        end = clock() + _LONGEST_REST_S
        while _await(reader, state, clock, site.connect_timeout).in_motion != 0:
            if clock() > end:
                raise HardwareError(
                    f"the controller still reports motion {_LONGEST_REST_S:g} s after the stop: "
                    "press HOLD on the pendant"
                )
        moved = float(np.abs(reader.feedback.positions - before).max())
        return QueueCleared(True, moved)
    finally:
        if state is not None:
            state.close()
        lock.release()


def _await(
    reader: FeedbackReader, link: TcpLink, clock: Callable[[], float], most: float
) -> RobotStatus:
    """Wait at most `most`, s, for the next status of the robot."""
    end, seen = clock() + most, reader.statuses
    while reader.statuses == seen or reader.status is None:
        left = end - clock()
        if left <= 0.0:
            raise HardwareError(f"no status of the robot has come for {most:g} s")
        link.wait(left)
        reader.poll(clock())
    return reader.status


def _stop(site: ControllerSite) -> None:
    """Connect, send the stop, and disconnect once it is answered."""
    link = TcpLink.connect(
        site.host, site.motion_port, site.connect_timeout, "controller's motion server"
    )
    try:
        reply = request_stop(link, max(site.reply_timeout, LEAVE_TIMEOUT_S))
        if reply is None:
            why = link.closed or f"none that can be read within {site.reply_timeout:g} s"
            raise HardwareError(
                f"the stop was not answered ({why}); does another client drive the robot? Press "
                "HOLD on the pendant"
            )
        if reply.result != Result.SUCCESS:
            raise HardwareError(
                f"the controller refuses the stop (reply {reply.result}/{reply.subcode}); press "
                "HOLD on the pendant"
            )
    finally:
        link.close()
