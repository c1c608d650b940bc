"""Query a controller without the driver's motion: its ports, its feedback, its inputs."""

import dataclasses as dc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.controller_state import RobotStatus
from unwrinkle.hardware.motoros.messages import (
    FeedbackBody,
    Framer,
    IoResult,
    Message,
    MessageType,
    MultiFeedback,
    ReadIo,
    ReadIoReply,
    RobotStatusBody,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import ControllerSite

#: Time for which the state server is read, s.
LISTEN = 1.0
#: Columns of each group's joints among the thirteen axes.
COLUMNS = {"r1": slice(1, 7), "r2": slice(7, 13), "ext_axis": slice(0, 1)}


@dataclass(frozen=True, eq=False)
class ControllerFacts:
    """Messages of a controller's state server during `LISTEN` seconds.

    Attributes:
        status: status of the robot; None if none arrived.
        groups: numbers of the groups that sent feedback.
        positions: (13,) rad, of the last complete set; None if none arrived.
        rate: complete sets per second.
        longest_gap: longest time between two sets, s.
    """

    status: RobotStatus | None
    groups: tuple[int, ...]
    positions: Array | None
    rate: float
    longest_gap: float


def reach(site: ControllerSite, name: str, port: int) -> str:
    """Connect to a port and disconnect; nothing is sent.

    Raises:
        HardwareError: nothing answers at the port, or another program drives the robot.
    """
    # A controller drops its present client when another one connects, so the owner's lock is
    # checked first.
    lock = OwnerLock(site.host, site.motion_port)
    lock.acquire()
    try:
        link = TcpLink.connect(site.host, port, site.connect_timeout, f"controller, {name} server")
        link.close()
    finally:
        lock.release()
    return f"{site.host}:{port} answers"


def listen(site: ControllerSite, clock: Callable[[], float] = time.monotonic) -> ControllerFacts:
    """Read the state server for `LISTEN` seconds.

    Raises:
        HardwareError: nothing answers, a message cannot be decoded, or the connection is closed.
    """
    name = "controller, state server"
    link = TcpLink.connect(site.host, site.state_port, site.connect_timeout, name)
    framer, messages = Framer(), list[tuple[float, Message]]()
    try:
        begin = clock()
        while (left := begin + LISTEN - clock()) > 0.0 and not link.closed:
            link.wait(left)
            messages += [(clock(), message) for message in framer.feed(link.receive())]
        if link.closed:
            raise HardwareError(f"{link.closed}; does another program use up its connections?")
    finally:
        link.close()
    return _facts(site, messages)


def _facts(site: ControllerSite, messages: Sequence[tuple[float, Message]]) -> ControllerFacts:
    status, seen = None, set[int]()
    # A controller may send each group alone, all groups at once, or both: each way is a series of
    # its own.
    series = (_Sets(site), _Sets(site))
    for when, message in messages:
        if message.type == MessageType.ROBOT_STATUS:
            status = RobotStatus(*dc.astuple(RobotStatusBody.of(message)))
        groups: tuple[FeedbackBody, ...] = ()
        if message.type == MessageType.JOINT_FEEDBACK:
            groups = (FeedbackBody.of(message),)
        elif message.type == MessageType.JOINT_FEEDBACK_EX:
            groups = MultiFeedback.of(message).groups
        seen.update(group.group for group in groups)
        series[message.type == MessageType.JOINT_FEEDBACK_EX].take(when, groups)
    sets = max(series, key=lambda found: len(found.times))
    gaps = np.diff(sets.times)
    rate = len(gaps) / float(np.sum(gaps)) if len(gaps) and np.sum(gaps) > 0.0 else 0.0
    longest = float(gaps.max()) if len(gaps) else np.inf
    known = sets.positions if sets.times else None
    return ControllerFacts(status, tuple(sorted(seen)), known, rate, longest)


class _Sets:
    """Assemble complete sets of feedback from the groups' messages."""

    def __init__(self, site: ControllerSite) -> None:
        self._groups = site.groups
        self._missing = set(range(len(site.groups)))
        self.times: list[float] = []
        self.positions = np.full(13, np.nan)

    def take(self, when: float, groups: Sequence[FeedbackBody]) -> None:
        for group in groups:
            if group.group < len(self._groups) and group.positions is not None:
                columns = COLUMNS[self._groups[group.group]]
                self.positions[columns] = group.positions[: columns.stop - columns.start]
                self._missing.discard(group.group)
        if groups and not self._missing:
            self.times.append(when)
            self._missing = set(range(len(self._groups)))


def problem_of(site: ControllerSite, facts: ControllerFacts) -> str:
    """Return what is wrong with the feedback; empty if nothing is."""
    expected = tuple(range(len(site.groups)))
    if not facts.groups:
        return "no joint feedback arrived within a second; is the port that of the state server?"
    if facts.groups != expected:
        return (
            f"feedback arrived of the groups {list(facts.groups)}, expected {list(expected)} "
            f"({', '.join(site.groups)}); does the controller run the three-group firmware?"
        )
    expected_rate = 1.0 / site.feedback_period
    if not 0.8 * expected_rate <= facts.rate <= 1.25 * expected_rate:
        return (
            f"{facts.rate:.1f} sets of feedback arrived per second, expected {expected_rate:.1f}; "
            "check controller.feedback_period and the load of the network"
        )
    if facts.longest_gap > site.hold_after:
        return (
            f"the longest gap between two sets of feedback was {1e3 * facts.longest_gap:.0f} ms; a "
            f"motion would hold after {1e3 * site.hold_after:.0f} ms; use a dedicated network "
            "cable and stop other programs"
        )
    return ""


def read_inputs(site: ControllerSite, addresses: Sequence[int]) -> dict[int, int | None]:
    """Read addresses of the controller's I/O; None for an address that it refuses.

    Raises:
        HardwareError: nothing answers, or another program drives the robot.
    """
    lock = OwnerLock(site.host, site.motion_port)
    lock.acquire()  # as in `reach`
    try:
        return _inputs(site, addresses)
    finally:
        lock.release()


def _inputs(site: ControllerSite, addresses: Sequence[int]) -> dict[int, int | None]:
    name = "controller, I/O server"
    link = TcpLink.connect(site.host, site.io_port, site.connect_timeout, name)
    framer, values = Framer(), dict[int, int | None]()
    try:
        for address in addresses:
            link.send(ReadIo(address).to_message().encode())
            answers: list[Message] = []
            end = time.monotonic() + site.connect_timeout
            while not answers and not link.closed and time.monotonic() < end:
                link.wait(end - time.monotonic())
                answers = framer.feed(link.receive())
            if not answers:
                raise HardwareError(f"{name} at {site.host}:{site.io_port} does not answer")
            reply = ReadIoReply.of(answers[0])
            values[address] = reply.value if reply.result == IoResult.OK else None
    finally:
        link.close()
    return values
