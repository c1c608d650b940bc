"""The virtual controller on the network: the three ports of a DX100 with MotoROS, and injected
faults.
"""

import select
import socket
from collections import deque
from contextlib import suppress
from math import floor

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.hardware.motoros.messages import (
    Command,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    Result,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.connection import Connection
from unwrinkle.simulation.controllers.controller import AXES, GROUP_AXES, VirtualController
from unwrinkle.simulation.controllers.faults.feedback import FeedbackFaults
from unwrinkle.simulation.controllers.faults.kinds import KINDS, Faults, ServerFault, corrupted
from unwrinkle.simulation.controllers.faults.replies import (
    begin_on_pendant,
    end_on_pendant,
    io_fault,
    motion_fault,
    with_wrong_sequence,
)
from unwrinkle.simulation.controllers.reads import Unread, read_messages
from unwrinkle.simulation.controllers.settings import Firmware

__all__ = ["KINDS", "ControllerServer", "ServerFault"]


MOTION, STATE, IO = "motion", "state", "io"
#: Limits of clients.
_MOST_CONNECTIONS = {MOTION: 1, STATE: 4, IO: 1}
#: Bytes of one read at most: the receive buffer of each firmware.
_MOST_READ = {Firmware.MOTOROS_1_9_12: 552, Firmware.OF_2013: 152}
#: Limit of reads of one connection in one poll.
_MOST_READS = 32
#: Longest time that is simulated after a gap between polls, s.
_LONGEST_CATCH_UP_S = 1.0
#: Group of each axis, and its slot in that group.
_PLACES = [
    next((g, axes.index(axis)) for g, axes in enumerate(GROUP_AXES) if axis in axes)
    for axis in range(AXES)
]


class ControllerServer:
    """Serves one virtual controller.

    Attributes:
        controller: served.
        ports: of motion, state and I/O.
        rejected: invalid bytes: name of the port, and "size" or "type".
        events: time since the first poll, s, and a sentence; the newest thousand.
    """

    def __init__(
        self,
        controller: VirtualController,
        host: str = "127.0.0.1",
        ports: tuple[int, int, int] = (0, 0, 0),
        faults: tuple[ServerFault, ...] = (),
    ) -> None:
        """Listen.

        Args:
            controller: to serve.
            host: address to listen on.
            ports: of motion, state and I/O; 0 lets the system choose.
            faults: to inject.

        Raises:
            HardwareError: a port is in use, or the address is not this machine's.
        """
        self.controller = controller
        self.rejected: deque[tuple[str, str]] = deque(maxlen=1000)
        self.events: deque[tuple[float, str]] = deque(maxlen=1000)
        self._faults = Faults(faults)
        self._feedback = FeedbackFaults(self._faults)
        self._most_read = _MOST_READ[Firmware(controller.settings.firmware)]
        self._random = np.random.default_rng(0)
        self._tiny = any(fault.kind == "tiny_buffers" for fault in faults)
        self._listeners: dict[str, socket.socket] = {}
        self._connections: dict[str, list[Connection]] = {MOTION: [], STATE: [], IO: []}
        self._first: float | None = None
        self._now = 0.0
        self._ticks = self._sets = 0
        self._release = float("inf")
        try:
            for name, port in zip((MOTION, STATE, IO), ports, strict=True):
                self._listeners[name] = self._listen(host, port, name)
        except HardwareError:
            self.close()
            raise
        self.ports = tuple(s.getsockname()[1] for s in self._listeners.values())

    @property
    def links(self) -> dict[str, list[TcpLink]]:
        """The links of "motion", "state" and "io", oldest first."""
        return {
            name: [connection.link for connection in connections]
            for name, connections in self._connections.items()
        }

    @property
    def motion(self) -> list[TcpLink]:
        """The motion connection, if there is one."""
        return self.links[MOTION]

    @property
    def state(self) -> list[TcpLink]:
        """The state connections."""
        return self.links[STATE]

    @property
    def io(self) -> list[TcpLink]:
        """The connection for inputs and outputs, if there is one."""
        return self.links[IO]

    def poll(
        self,
        now: float,
        measured: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
    ) -> None:
        """Simulate up to a time: accept, read, reply, interpolate, send feedback. Never blocks.

        Args:
            now: of any monotonic clock, s.
            measured, velocities: (13,) of the axes now, rad and rad/s; None is as commanded.
        """
        if self._first is None:
            self._first = now
        self._now = max(now - self._first, self._now)
        self._change_faults()
        self.answer()
        self._interpolate()
        for reply in self.controller.late_replies():
            self._answer(MOTION, reply)
        self._send_feedback(measured, velocities)
        split = self._faults.any_of("split") is not None
        for name, connections in self._connections.items():
            for connection in connections:
                connection.flush(split)
            self._forget_closed(name)

    def answer(self) -> None:
        """Accept clients, and read and answer their messages, without simulating time."""
        for name in (MOTION, STATE, IO):
            self._read(name)
            if self._accept(name):
                self._read(name)
        self._answer_waiting()

    def wait(self, most: float) -> None:
        """Wait at most `most`, s, until a client connects or sends; controllers reply at once."""
        links = [link for found in self.links.values() for link in found if not link.closed]
        with suppress(OSError, ValueError):  # closed meanwhile
            ends = [link.fileno() for link in links]
            ends += [listener.fileno() for listener in self._listeners.values()]
            select.select(ends, [], [], most)

    def commit(self, fault: ServerFault) -> None:
        """Add a fault; its times count from the server's first poll."""
        self._faults.add(fault)

    def stop_listening(self, name: str) -> None:
        """Close the port "motion", "state" or "io"; new connections are refused."""
        if listener := self._listeners.pop(name, None):
            listener.close()

    def close(self) -> None:
        """Close every connection and port; a second call changes nothing."""
        for connections in self._connections.values():
            for connection in connections:
                connection.link.close()
            connections.clear()
        for listener in self._listeners.values():
            listener.close()
        self._listeners.clear()

    def _listen(self, host: str, port: int, name: str) -> socket.socket:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if self._tiny:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
            listener.bind((host, port))
            listener.listen(8)
            listener.setblocking(False)
        except OSError as error:
            listener.close()
            raise HardwareError(
                f"virtual controller: cannot listen on {host}:{port} ({name}): "
                f"{error.strerror or error}; is another one running? Give other ports"
            ) from None
        return listener

    def _accept(self, name: str) -> bool:
        """Accept new clients; return whether there are any."""
        new = False
        for _ in range(8):
            try:
                accepted, address = self._listeners[name].accept()
            except (OSError, KeyError):
                break
            link = TcpLink(accepted, f"{name} client {address[0]}:{address[1]}")
            connections = self._connections[name]
            full = len(connections) >= _MOST_CONNECTIONS[name]
            newer = (
                self.controller.settings.firmware != Firmware.OF_2013
            )  # which keeps the older one
            if full and newer and not any(self.controller.queued):
                connections[0].link.close(f"replaced by another {name} connection")
                self._forget_closed(name)
            ending = name == MOTION and self.controller.parting and any(self.controller.queued)
            if ending or len(connections) >= _MOST_CONNECTIONS[name]:
                link.close(f"more than {_MOST_CONNECTIONS[name]} {name} connections")
                self._event(f"{link.name} refused: {link.closed}")
                continue
            connections.append(Connection(link))
            self._event(f"{link.name} connected")
            if name == MOTION:
                if any(self.controller.queued):
                    self._event("increments that were left in the queues are run")
                self.controller.connection_made()
            new = True
        return new

    def _forget_closed(self, name: str) -> None:
        connections = self._connections[name]
        for connection in [c for c in connections if c.link.closed]:
            connections.remove(connection)
            self._event(f"{connection.link.name}: {connection.link.closed}")
            if name == MOTION:
                self.controller.connection_lost()
                if any(self.controller.queued):
                    self._event("the queues are not empty; they are run at the next connection")

    def _event(self, text: str) -> None:
        self.events.append((self._now, text))

    def _read(self, name: str) -> None:
        """Read and answer, one read at a time as the firmware does."""
        silent = self._faults.any_of("silent", f"silent_{name}") is not None
        for connection in self._connections[name]:
            for _ in range(_MOST_READS):
                if connection.link.closed or (name == MOTION and self.controller.starting):
                    break  # busy with the start; bytes wait
                data = self._one_read(connection, name)
                if not data:
                    break
                if silent or name == STATE:  # which answers nothing
                    continue
                self._take(name, data, connection)
        self._forget_closed(name)

    def _answer_waiting(self) -> None:
        """Answer messages that waited for the start of trajectory mode."""
        for connection in self._connections[MOTION]:
            while connection.waiting and not self.controller.starting:
                self._handle(MOTION, connection.waiting.popleft(), connection)

    def _one_read(self, connection: Connection, name: str) -> bytes:
        """Return the bytes of the next read; faults delay it, or cut it in two."""
        if slow := self._faults.any_of("slow"):
            connection.credit += slow.value or 16.0
            if connection.credit < self._most_read:
                return b""
            connection.credit = 0.0
        if name != MOTION:
            return connection.link.receive(self._most_read)
        if rest := connection.rest:
            connection.rest = b""
            return rest
        if together := self._faults.any_of("coalesce"):
            # Bytes within this time of the first one are read together.
            waits = connection.link.wait(0.0)
            if not waits or connection.link.closed:
                connection.since = None
                return connection.link.receive(self._most_read)
            connection.since = self._now if connection.since is None else connection.since
            if self._now - connection.since < together.value - 1e-9:
                return b""
            connection.since = None
        data = connection.link.receive(self._most_read)
        if (cut := self._faults.any_of("cut")) and len(data) > 1:
            place = min(int(cut.value) or 20, len(data) - 1)
            connection.rest, data = data[place:], data[:place]
        return data

    def _take(self, name: str, data: bytes, connection: Connection) -> None:
        """Answer the messages of one read."""
        found = read_messages(data, self.controller.settings.firmware)
        if name == MOTION and len(found) > 1 and not any(isinstance(m, Unread) for m in found):
            self.controller.audit.several(len(found))
        connection.waiting.extend(found)
        while connection.waiting and not connection.link.closed:
            if name == MOTION and self.controller.starting:
                break
            self._handle(name, connection.waiting.popleft(), connection)

    def _handle(self, name: str, message: Message | Unread, connection: Connection) -> None:
        handle = self.controller.handle_io if name == IO else self.controller.handle_motion
        replies: list[Message] = []
        if isinstance(message, Unread):
            self.rejected.append((name, message.name))
        else:
            replies = (io_fault if name == IO else motion_fault)(self._faults, message)
        if replies and not isinstance(message, Unread):
            self.controller.messages.append((self.controller.time, message))
        else:
            replies = handle(message)
        for reply in replies:
            self._answer(name, reply)
        if name == MOTION and _ends(message, replies):
            connection.link.flush()
            connection.link.close("disconnected")

    def _answer(self, name: str, reply: Message) -> None:
        """Send a reply on a port's connection."""
        if self._faults.any_of("silent", f"silent_{name}") or not self._connections[name]:
            return
        if reply.type == MessageType.MOTION_REPLY and self._faults.any_of("wrong_sequence"):
            reply = with_wrong_sequence(reply)
        self._write(self._connections[name][0], reply, name)

    def _write(self, connection: Connection, message: Message, name: str) -> None:
        data = corrupted(message.encode(), self._faults, name == MOTION, self._random)
        connection.send(data, self._faults.any_of("split") is not None)

    def _interpolate(self) -> None:
        period = self.controller.settings.period
        due = floor(self._now / period + 1e-6)
        self._ticks = max(self._ticks, due - floor(_LONGEST_CATCH_UP_S / period + 1e-6))
        while self._ticks < due:
            self._ticks += 1
            self.controller.advance()

    def _send_feedback(self, measured: ArrayLike | None, velocities: ArrayLike | None) -> None:
        """Send a set of feedback each period; missed sets are skipped."""
        due = floor(self._now / self.controller.settings.feedback_period + 1e-6) + 1
        if due <= self._sets:
            return
        self._sets = due
        q = (
            self.controller.axis_positions
            if measured is None
            else np.asarray(measured, dtype=float)
        )
        v = (
            self.controller.axis_velocities
            if velocities is None
            else np.asarray(velocities, dtype=float)
        )
        q, v = self._feedback.measured(q, v, self._now)
        messages = self._feedback.messages(self.controller.feedback(q, v), _PLACES)
        sets = self._feedback.due(messages, self._now)
        if self._faults.any_of("silent", "silent_state"):
            return
        for connection in self._connections[STATE]:
            for message in sets:
                self._write(connection, message, STATE)

    def _change_faults(self) -> None:
        controller = self.controller
        begun, ended = self._faults.update(self._now, controller.points)
        for fault in begun:
            self._event(f"fault {fault.kind} begins: {KINDS[fault.kind]}")
            begin_on_pendant(controller.pendant, fault)
            if fault.kind == "e_stop_released":
                self._release = self._now + fault.value
            self._close_for(fault)
        for fault in ended:
            self._event(f"fault {fault.kind} ends")
            end_on_pendant(controller.pendant, fault)
        if self._now >= self._release:
            self._release = float("inf")
            controller.pendant.release_e_stop()
            self._event("the emergency stop is released")

    def _close_for(self, fault: ServerFault) -> None:
        for name, connections in self._connections.items():
            if fault.kind in (f"close_{name}", "close_all"):
                for connection in connections:
                    connection.link.close(f"fault {fault.kind}")
                self._forget_closed(name)


def _ends(message: Message | Unread, replies: list[Message]) -> bool:
    """Return whether the message is a DISCONNECT that was not refused."""
    if isinstance(message, Unread) or message.type != MessageType.MOTION_CTRL:
        return False
    asked = MotionControl.of(message).command == Command.DISCONNECT
    return asked and (not replies or MotionReply.of(replies[0]).result == Result.SUCCESS)
