"""Fixtures of the hardware tests: limits, and trajectories made of quintics."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.motoros.messages import MessageType, MotionControl
from unwrinkle.hardware.run_log.protocol import RunLogger
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.limits import Limits, load_limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.sent_samples import as_float32
from unwrinkle.planning.trajectory import AXES, Trajectory, rate_extremes
from unwrinkle.simulation.controllers.controller import (
    GROUP_AXES,
    VirtualController,
    VirtualControllerSettings,
)
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault
from unwrinkle.systems.station.loopback.lockstep import MAX_REQUESTS_PER_STEP

TrajectoryMaker = Callable[..., Trajectory]

STEP = 0.008


@pytest.fixture(scope="session")
def limits() -> Limits:
    """The robot's."""
    return load_limits(models_dir() / "limits.yaml")


@pytest.fixture(scope="session")
def stream_limits(limits: Limits) -> StreamLimits:
    return StreamLimits.of(limits)


@pytest.fixture(scope="session")
def make_trajectory(stream_limits: StreamLimits) -> TrajectoryMaker:
    """Rest-to-rest trajectories as sent, in float32 and whole ms.

    Every axis moves by a few overlapping quintics, as fast as the limits allow.
    """

    def make(seed: int = 0, reach: float = 0.6, start: np.ndarray | None = None) -> Trajectory:
        rng = np.random.default_rng(seed)
        strokes = rng.integers(1, 4, AXES)
        begin = np.zeros(AXES) if start is None else start
        moves = [
            (axis, *np.sort(rng.uniform(0.0, 1.0, 2)), rng.uniform(-reach, reach))
            for axis in range(AXES)
            for _ in range(strokes[axis])
        ]

        def sample(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            times = np.round(STEP * np.arange(int(np.ceil(duration / STEP)) + 1), 3)
            positions = np.tile(begin, (len(times), 1))
            velocities = np.zeros_like(positions)
            for axis, first, last, length in moves:
                first, last = 0.7 * first * times[-1], (0.3 + 0.7 * last) * times[-1]
                x = np.clip((times - first) / (last - first), 0.0, 1.0)
                positions[:, axis] += length * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
                velocities[:, axis] += length * 30.0 * x**2 * (1.0 - x) ** 2 / (last - first)
            return times, as_float32(positions), as_float32(velocities)

        duration = 0.4
        while True:
            times, positions, velocities = sample(duration)
            used = rate_extremes(times, positions, velocities)
            bounds = (stream_limits.velocity, stream_limits.acceleration, stream_limits.jerk)
            if max((a / b).max() for a, b in zip(used, bounds, strict=True)) <= 0.985:
                return Trajectory(times, positions, velocities)
            duration *= 1.05

    return make


class Rig:
    """A driver and a virtual controller over TCP on loopback, polled in turn on one clock that the
    test moves.

    Each turn lasts 4 ms; before the driver reads, all that the server has sent has arrived, and the
    other way round.
    """

    def __init__(
        self,
        limits: Limits,
        folder: Path,
        faults: tuple[ServerFault, ...] = (),
        settings: VirtualControllerSettings | None = None,
        log: RunLogger | None = None,
        lag: float = 0.0,
        **site: object,
    ) -> None:
        self.controller = VirtualController(
            settings or VirtualControllerSettings(),
            np.zeros(AXES),
            (limits.lower, limits.upper, limits.velocity),
        )
        self.server = ControllerServer(self.controller, faults=faults)
        motion, state, io = self.server.ports
        ports = {"motion_port": motion, "state_port": state, "io_port": io}
        self.site = ControllerSite(**{**ports, "speed_cap": 1.0, **site})  # type: ignore[arg-type]
        self.driver = ControllerDriver(
            self.site, limits, log=log, command="test", lock_directory=folder
        )
        self.time = 100.0
        self.lag = lag
        self.measured = np.zeros(AXES)
        self.number = 0

    def connect(self) -> None:
        """Connect and wait until the driver is ready or in fault."""
        self.driver.connect()
        self.until(lambda: self.driver.status.state != "connecting", 5.0)

    def turn(self, step: float = 0.004, serve: bool = True) -> None:
        """Move on, the server first."""
        if serve:
            self._serve(step)
        else:
            self.time += step
        for _ in range(MAX_REQUESTS_PER_STEP if serve else 1):
            before = self._asked()
            self.driver.poll(self.time)
            self._arrive(self.driver.links, self.server.links)
            if not serve or self._asked() == before:
                break
            self.server.answer()
            self._arrive(self.server.links, self.driver.links)

    def turn_server(self, step: float = 0.001) -> None:
        """Move on the server alone, after the driver was polled by something else."""
        self._arrive(self.driver.links, self.server.links)
        self.server.answer()
        self._serve(step)

    def _serve(self, step: float) -> None:
        self.time += step
        self.measured += (self.controller.axis_positions - self.measured) * (
            1.0 if self.lag == 0.0 else min(step / self.lag, 1.0)
        )
        self.server.poll(self.time, self.measured)
        self._arrive(self.server.links, self.driver.links)

    def _asked(self) -> tuple[str, int]:
        link = self.driver.links.get("motion")
        return ("", 0) if link is None else (link.closed, link.sent)

    def until(self, condition: Callable[[], bool], longest: float = 20.0) -> float:
        """Take turns until something holds; s that it took."""
        begin = self.time
        while not condition():
            assert self.time - begin < longest, f"not within {longest} s: {self.driver.status}"
            self.turn()
        return self.time - begin

    def wait(self, duration: float) -> None:
        """Take turns for so long."""
        end = self.time + duration
        while self.time < end:
            self.turn()

    def run(self, trajectory: Trajectory, name: str = "") -> int:
        """Command a trajectory and wait until it moves, or is refused."""
        self.number += 1
        self.driver.run(self.number, trajectory, name)
        self.until(lambda: self.driver.status.state != "starting")
        return self.number

    def next_number(self) -> int:
        self.number += 1
        return self.number

    @property
    def state(self) -> str:
        return self.driver.status.state

    @property
    def reason(self) -> str:
        return self.driver.status.reason

    def sent_commands(self) -> list[int]:
        """Motion commands that the controller received, in order."""
        return [
            MotionControl.of(message).command
            for _, message in self.controller.messages
            if message.type == MessageType.MOTION_CTRL
        ]

    def received(self) -> Trajectory:
        """What the controller took, as one trajectory of thirteen axes."""
        groups = self.controller.received
        count = min(len(group) for group in groups)
        positions, velocities = np.zeros((count, AXES)), np.zeros((count, AXES))
        for group, axes in zip(groups, GROUP_AXES, strict=True):
            for k in range(count):
                positions[k, list(axes)] = group[k].positions
                velocities[k, list(axes)] = group[k].velocities
        times = np.array([group.milliseconds / 1e3 for group in list(groups[0])[:count]])
        return Trajectory(times, positions, velocities)

    def close(self) -> None:
        self.driver.close()
        self.server.close()

    def _arrive(self, senders: object, receivers: object) -> None:
        """Wait until the system has delivered what was sent."""
        for name in ("motion", "state", "io"):
            ends = [links.get(name) for links in (senders, receivers)]  # type: ignore[attr-defined]
            sender, receiver = (
                (end[0] if end else None) if isinstance(end, list) else end for end in ends
            )
            if sender is None or receiver is None or sender.closed or receiver.closed:
                continue
            if sender.sent > receiver.received:
                receiver.wait(1.0)


RigMaker = Callable[..., Rig]


@pytest.fixture
def make_rig(limits: Limits, tmp_path: Path) -> Iterator[RigMaker]:
    """Rigs that are closed in the end."""
    rigs: list[Rig] = []

    def make(**arguments: object) -> Rig:
        rig = Rig(limits, tmp_path, **arguments)  # type: ignore[arg-type]
        rigs.append(rig)
        return rig

    yield make
    for rig in rigs:
        rig.close()
