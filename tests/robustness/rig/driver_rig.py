"""The rig of the driver's faults: virtual controller, its server, the driver and a run log, in
lockstep on a fake clock.

Bytes go over real sockets of the loopback interface. Before either side is polled, everything that
the other side has sent has come; so a run depends on nothing but its seed.
"""

import dataclasses as dc
import errno
import fcntl
import os
import struct
import termios
import threading
import time as wall
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tests.robustness.rig.sent_limits import SentPoints, limit_violations
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller_state import DriverStatus
from unwrinkle.hardware.motoros.messages import MessageType, MotionControl
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.arrays import Array
from unwrinkle.models.site import ControllerSite, loopback_site
from unwrinkle.planning.trajectory import AXES, Trajectory
from unwrinkle.simulation.controllers.controller import (
    GROUP_AXES,
    AcceptedPoint,
    VirtualController,
    VirtualControllerSettings,
)
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault
from unwrinkle.systems.station.loopback.lockstep import MAX_REQUESTS_PER_STEP
from unwrinkle.testing.cells import cell

#: s between two polls of either side.
STEP = 0.004
#: Lag of the axes behind what the controller commands, s.
AXES_LAG = 0.010
#: s to wait for bytes that are on their way through the machine, wall clock.
_DELIVERY = 0.25
#: Axes slower than this are at rest, rad/s.
_REST = 1e-4

#: Where the thirteen axes go from home in the standard motion, rad.
WAY = np.array([0.15, 0.20, -0.25, 0.15, 0.30, 0.20, -0.40, -0.20, -0.25, 0.15, -0.30, 0.20, 0.40])


def swing(start: Array, way: Array = WAY, duration: float = 1.0, step: float = 0.008) -> Trajectory:
    """A motion of all axes from rest to rest along a line, rad and s, sampled at a step.

    Its speed is a polynomial with three vanishing derivatives at both ends.
    """
    count = round(duration / step)
    u = np.linspace(0.0, 1.0, count + 1)
    share = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    rate = 140.0 * u**3 * (1.0 - u) ** 3 / (count * step)
    times = np.round(step * np.arange(count + 1, dtype=float), 3)
    positions = np.asarray(start + np.outer(share, way), dtype=float)
    return Trajectory(times, positions, np.outer(rate, way))


@dataclass
class Disk:
    """What a run log is written to.

    Attributes:
        full: nothing more can be written.
    """

    full: bool = False


class DiskLog:
    """A run log on a disk that may become full."""

    def __init__(self, log: RunLog, disk: Disk) -> None:
        """Write to a log as long as there is room."""
        self._log, self._disk = log, disk

    def __getattr__(self, name: str) -> Any:
        """The log's own method, which raises OSError where the disk is full."""

        def write(*args: Any, **data: Any) -> None:
            if self._disk.full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            getattr(self._log, name)(*args, **data)

        return write


class Rig:
    """All of it.

    Attributes:
        now: the fake clock, s.
        controller, server, driver: what it is made of.
        log_path: of the run log.
        history: now, positions (13,) measured and driver's state, of every step.
        states: of the driver, in order, each with when it began.
        number: of the last command given.
        trajectory: that was run last.
    """

    def __init__(
        self,
        folder: Path,
        *faults: ServerFault,
        site: dict[str, Any] | None = None,
        settings: VirtualControllerSettings | None = None,
        start: Array | None = None,
        disk: "Disk | None" = None,
        name: str = "rig",
        step: float = STEP,
        axes_lag: float = AXES_LAG,
        needs_io: bool = True,
    ) -> None:
        """Listen and connect nothing yet.

        Args:
            folder: for the log.
            faults: of the server.
            site: what differs from the shipped loopback site's controller.
            settings: of the virtual controller.
            start: (13,) rad; home if left out.
            disk: that the run log is written to; one with room if left out.
            name: of the log's file.
            step: s between two polls of either side.
            axes_lag: time constant of the axes behind what the controller tells them, s.
            needs_io: whether inputs and outputs are needed.
        """
        self._axes_lag = axes_lag
        self.limits = cell().limits
        self._step = step
        self.now = 100.0
        self.start = np.zeros(AXES) if start is None else np.array(start, dtype=float)
        limits = (self.limits.lower, self.limits.upper, self.limits.velocity)
        self.controller = VirtualController(
            settings or VirtualControllerSettings(), self.start, limits
        )
        self.server = ControllerServer(self.controller, faults=faults)
        self._tiny = any(fault.kind in ("tiny_buffers", "slow") for fault in faults)
        motion, state, io = self.server.ports
        self.site: ControllerSite = dc.replace(
            loopback_site().controller, motion_port=motion, state_port=state, io_port=io
        )
        self.site = dc.replace(self.site, **(site or {}))
        self.log_path = folder / f"{name}.jsonl"
        self.log = RunLog.create(self.log_path, {"what": "fault row"})
        self.disk = disk or Disk()
        logger: Any = DiskLog(self.log, self.disk)
        self.driver = ControllerDriver(self.site, self.limits, log=logger, io=needs_io)
        self.measured = self.start.copy()
        self.speed = np.zeros(AXES)
        self.history: list[tuple[float, Array, str]] = []
        self.states: list[tuple[float, str]] = []
        self.number = 0
        self.trajectory: Trajectory | None = None
        self.serving = True
        self.late = 0.0  # of the host's clock against the controller's, s
        self._closed = False

    def __enter__(self) -> Self:
        """The rig itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close everything."""
        self.close()

    @property
    def status(self) -> DriverStatus:
        """The driver's."""
        return self.driver.status

    @property
    def state(self) -> str:
        """The driver's."""
        return self.driver.status.state

    # ------------------------------------------------------------ time

    def world(self) -> None:
        """The controller and the axes move on; the host does not."""
        step = self._step
        self.now += step
        share = 1.0 - np.exp(-step / self._axes_lag) if self._axes_lag > 0.0 else 1.0
        before = self.measured
        self.measured = before + share * (self.controller.axis_positions - before)
        self.speed = (self.measured - before) / step
        if self.serving:
            self._deliver(self._server_links(), self._driver_links())
            self.server.poll(self.now, self.measured, self.speed)

    def step(self, count: int = 1) -> None:
        """Poll the server and the driver in turn, so many times."""
        for _ in range(count):
            self.world()
            self._exchange()
            state = self.state
            self.history.append((self.now, self.measured, state))
            if not self.states or self.states[-1][1] != state:
                self.states.append((self.now, state))

    def _exchange(self) -> None:
        """Poll the driver, and have what it asks answered, request by request."""
        for _ in range(MAX_REQUESTS_PER_STEP):
            self._deliver(self._driver_links(), self._server_links())
            link = self.driver.links.get("motion")
            before = None if link is None else (link.sent, link.closed)
            self.driver.poll(self.now + self.late)
            link = self.driver.links.get("motion")
            after = None if link is None else (link.sent, link.closed)
            if after == before or not self.serving:
                return
            self._deliver(self._server_links(), self._driver_links())
            self.server.answer()

    def until(self, holds: Callable[[], bool], most: float) -> bool:
        """Go on until something holds, for at most so long (s); whether it does."""
        end = self.now + most
        while not holds():
            if self.now > end:
                return False
            self.step()
        return True

    def sleep(self, duration: float) -> None:
        """The host sleeps; the controller does not."""
        for _ in range(round(duration / self._step)):
            self.world()

    # ------------------------------------------------------------ commands

    def connect(self, most: float = 3.0) -> bool:
        """Connect the driver and wait until it is ready or in fault; whether it is ready."""
        self.driver.connect()
        self.until(lambda: self.state in (controller_state.READY, controller_state.FAULT), most)
        return self.state == controller_state.READY

    def run(self, trajectory: Trajectory | None = None, name: str = "swing") -> int:
        """Run a trajectory, the standard one if left out; its number."""
        self.number += 1
        self.trajectory = trajectory or swing(self.controller.positions)
        self.driver.run(self.number, self.trajectory, name)
        return self.number

    def hold(self) -> int:
        """Hold; its number."""
        self.number += 1
        self.driver.hold(self.number)
        return self.number

    def resume(self) -> int:
        """Resume; its number."""
        self.number += 1
        self.driver.resume(self.number)
        return self.number

    def complete(self, number: int, most: float = 12.0) -> bool:
        """Go on until a command is completed, refused or at fault; whether it is completed."""
        self.until(
            lambda: (
                self.status.completed >= number
                or self.state == controller_state.FAULT
                or (
                    self.state in (controller_state.READY, controller_state.HELD)
                    and bool(self.status.reason)
                )
            ),
            most,
        )
        return self.status.completed >= number

    def moving(self, progress: float = 0.3) -> bool:
        """Go on until the robot is so far (s) along the trajectory; whether it got there."""
        return (
            self.until(
                lambda: (
                    (self.status.progress >= progress and self.state == controller_state.RUNNING)
                    or self.state == controller_state.FAULT
                ),
                8.0,
            )
            and self.state != controller_state.FAULT
        )

    def settle(self, most: float = 3.0) -> bool:
        """Go on until the axes rest and the driver's state stands; whether they do."""
        self.step(5)
        settled = self.until(
            lambda: np.abs(self.speed).max() < _REST and self.controller.resting, most
        )
        self.step(10)
        return settled

    def close(self) -> None:
        """Close the driver, the log and the server; a second time changes nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self.leave()
        finally:
            self.server.close()
            self.log.close()

    def leave(self) -> None:
        """Close the driver; that waits for answers, so the controller goes on meanwhile."""
        left = threading.Event()
        going = threading.Thread(target=self._go_on_until, args=(left,))
        going.start()
        try:
            self.driver.close()
        finally:
            left.set()
            going.join()

    def _go_on_until(self, left: threading.Event) -> None:
        while self.serving and not left.wait(0.001):
            self.now += self._step
            self.server.poll(self.now, self.measured, np.zeros(AXES))

    # ------------------------------------------------------------ what was sent

    def streams(self) -> list[SentPoints]:
        """What the controller accepted, group by group, cut at every point 0."""
        found = []
        for axes, points in zip(GROUP_AXES, self.controller.received, strict=True):
            parts: list[list[AcceptedPoint]] = []
            for point in points:
                if point.sequence == 0 or not parts:
                    parts.append([])
                parts[-1].append(point)
            found += [_sent(np.array(axes), part) for part in parts]
        return found

    def last_streams(self) -> list[SentPoints]:
        """The last stream of each group."""
        found: dict[int, SentPoints] = {}
        for stream in self.streams():
            found[int(stream.axes[0])] = stream
        return list(found.values())

    def violations(self) -> list[str]:
        """Limits that what was sent goes beyond."""
        return [*limit_violations(self.streams(), self.limits), *self.controller.audit.findings]

    def messages_after(self, when: float) -> list[Any]:
        """Motion messages but status questions that the controller received later than a time of
        `now`.
        """
        begin = self.controller.time - (self.now - when)
        return [m for clock, m in self.controller.messages if clock > begin]

    def points_after(self, when: float) -> int:
        """Trajectory points among them."""
        kinds = (MessageType.JOINT_TRAJ_PT_FULL, MessageType.JOINT_TRAJ_PT_FULL_EX)
        return sum(message.type in kinds for message in self.messages_after(when))

    def commands(self) -> list[int]:
        """Motion control commands that the controller received, in order."""
        return [
            MotionControl.of(message).command
            for _, message in self.controller.messages
            if message.type == MessageType.MOTION_CTRL
        ]

    def entered(self, state: str) -> float | None:
        """When the driver entered a state first; None if it did not."""
        return next((when for when, name in self.states if name == state), None)

    def since(self, state: str, when: float) -> float | None:
        """How long after a time the driver entered a state, s; None if it did not."""
        return next((t - when for t, name in self.states if name == state and t >= when), None)

    # ------------------------------------------------------------ where the arms stand

    def off_path(self) -> float:
        """Largest distance of an axis from one and the same point of the trajectory's path, rad."""
        assert self.trajectory is not None
        s = np.linspace(0.0, self.trajectory.duration, 4001)
        q = self.trajectory.interpolant()(s)
        return float(np.abs(q - self.controller.positions).max(axis=1).min())

    def rested(self) -> list[float]:
        """When the turn-table, the right and the left arm moved last, controller's clock, s."""
        moved = [0.0, 0.0, 0.0]
        for clock, _, v in self.controller.trace:
            for k, axes in enumerate(((0,), range(1, 7), range(7, 13))):
                if np.abs(v[list(axes)]).max() > _REST:
                    moved[k] = clock
        return moved

    # ------------------------------------------------------------ lockstep

    def _driver_links(self) -> dict[str, TcpLink]:
        return dict(self.driver.links)

    def _server_links(self) -> dict[str, TcpLink]:
        return {name: links[-1] for name, links in self.server.links.items() if links}

    def _deliver(self, receivers: dict[str, TcpLink], senders: dict[str, TcpLink]) -> None:
        """Wait until what was sent on every connection is there to be read."""
        end = wall.monotonic() + (0.002 if self._tiny else _DELIVERY)
        for name, receiver in receivers.items():
            sender = senders.get(name)
            if sender is None or receiver.closed:
                continue
            while sender.sent - receiver.received > _readable(receiver):
                if wall.monotonic() > end or sender.closed:
                    break
                wall.sleep(2e-5)


def _readable(link: TcpLink) -> int:
    """Bytes that have come and were not read."""
    try:
        answer = fcntl.ioctl(link.fileno(), termios.FIONREAD, b"\0" * 4)
    except OSError:
        return 1 << 30
    return int(struct.unpack("i", answer)[0])


def _sent(axes: NDArray[np.intp], points: list[AcceptedPoint]) -> SentPoints:
    return SentPoints(
        axes,
        np.array([point.clock for point in points]),
        np.array([point.milliseconds / 1e3 for point in points]),
        np.array([point.positions for point in points]),
        np.array([point.velocities for point in points]),
    )
