"""Fixtures of the tests of the virtual controller's server.

A client on all three ports, on a clock of its own.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    FeedbackBody,
    Framer,
    Message,
    MotionControl,
    MotionReply,
    MultiFeedback,
    RobotStatusBody,
    TrajectoryPoint,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.simulation.controllers.controller import (
    GROUP_AXES,
    VirtualController,
    VirtualControllerSettings,
)
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault

LIMITS = (np.full(13, -2.0), np.full(13, 2.5), np.full(13, 3.0))
Body = TrajectoryPoint | MotionControl | FeedbackBody | MultiFeedback | RobotStatusBody


class ControllerClient:
    """Talks to a server that it polls itself, in turn, on a fake clock.

    Attributes:
        server, controller: that it talks to.
        now: the clock, s.
        links: of "motion", "state" and "io".
    """

    def __init__(
        self, faults: tuple[ServerFault, ...], settings: VirtualControllerSettings
    ) -> None:
        self.controller = VirtualController(settings, np.zeros(13), LIMITS)
        self.server = ControllerServer(self.controller, faults=faults)
        self.now = 100.0
        self.links: dict[str, TcpLink] = {}
        self._framers: dict[str, Framer] = {}
        self._opened: list[TcpLink] = []
        for name, port in zip(("motion", "state", "io"), self.server.ports, strict=True):
            self.connect(name, port)
        self.poll()

    def connect(self, name: str, port: int | None = None) -> TcpLink:
        """Connect to a port, in place of the connection before."""
        if port is None:
            port = self.server.ports[("motion", "state", "io").index(name)]
        self.links[name] = TcpLink.connect("127.0.0.1", port, 2.0, name)
        self._framers[name] = Framer()
        self._opened = [link for link in self._opened if not link.closed]
        self._opened.append(self.links[name])
        return self.links[name]

    def poll(self, step: float = 0.0, **measured: np.ndarray) -> None:
        """Let the server move on, once it has all that was sent."""
        for name, link in self.links.items():
            for peer in self.server.links[name][-1:]:
                if not link.closed and peer.received < link.sent:
                    peer.wait(2.0)
        self.now += step
        self.server.poll(self.now, **measured)

    def send(self, name: str, message: Message) -> None:
        self.links[name].send(message.encode())

    def raw(self, name: str) -> bytes:
        """All bytes that have come."""
        data, link = b"", self.links[name]
        sent = sum(peer.sent for peer in self.server.links[name][-1:])
        while not link.closed and (link.received < sent or link.wait(0.0)):
            link.wait(2.0)
            data += link.receive()
        return data

    def read(self, name: str) -> list[Message]:
        """All messages that have come."""
        return self._framers[name].feed(self.raw(name))

    def ask(self, message: Message, name: str = "motion", step: float = 0.0) -> list[Message]:
        """Send a message and poll once; what comes back."""
        self.send(name, message)
        self.poll(step)
        return self.read(name)

    def start(self) -> None:
        """Start trajectory mode."""
        replies = self.ask(MotionControl(-1, 1, Command.START_TRAJ_MODE).to_message())
        for _ in range(300):
            if replies:
                break
            self.poll(0.004)
            replies = self.read("motion")
        assert [MotionReply.of(reply).result for reply in replies] == [0]

    def move(self, sequence: int, *, step: float | None = None) -> list[tuple[int, int]]:
        """Send one point of all groups on a slow ramp, a step (a period) after what was before.

        The results.
        """
        t = 0.02 * sequence
        out = []
        self.poll(self.controller.settings.period if step is None else step)
        for group, axes in enumerate(GROUP_AXES):
            q, v = (0.1 * t * t,) * len(axes), (0.2 * t,) * len(axes)
            body = TrajectoryPoint(group, sequence, t + 4e-4, q, v)
            (reply,) = self.ask(body.to_message())
            told = MotionReply.of(reply)
            out.append((told.result, told.subcode))
        return out

    def feedback(self, step: float = 0.025) -> np.ndarray:
        """The newest positions (13,) after a step; NaN where none came."""
        self.poll(step)
        positions = np.full(13, np.nan)
        for message in self.read("state"):
            if message.type == 15:
                body = FeedbackBody.of(message)
                assert body.positions is not None
                axes = GROUP_AXES[body.group]
                positions[list(axes)] = body.positions[: len(axes)]
        return positions

    def close(self) -> None:
        for link in self._opened:
            link.close()
        self.server.close()


ClientMaker = Callable[..., ControllerClient]


@pytest.fixture
def controller_client() -> Iterator[ClientMaker]:
    """Make a client and its server, with faults and settings."""
    made: list[ControllerClient] = []

    def make(*faults: ServerFault, **settings: object) -> ControllerClient:
        made.append(ControllerClient(faults, VirtualControllerSettings(**settings)))
        return made[-1]

    yield make
    for client in made:
        client.close()
