"""The driver's thread on the real clock against a virtual controller in another thread."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.thread import DriverThread
from unwrinkle.hardware.motoros.messages import Command, MessageType, MotionControl
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import AXES, Trajectory
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer

pytestmark = pytest.mark.alone

TrajectoryMaker = Callable[..., Trajectory]


@pytest.fixture
def server(limits: Limits) -> Iterator[ControllerServer]:
    """A server that runs in a thread, in real time."""
    controller = VirtualController(
        VirtualControllerSettings(servo_time=0.05, job_time=0.05),
        np.zeros(AXES),
        (limits.lower, limits.upper, limits.velocity),
    )
    server = ControllerServer(controller)
    end = threading.Event()

    def serve() -> None:
        while not end.is_set():
            server.poll(time.monotonic())
            server.wait(0.001)

    thread = threading.Thread(target=serve)
    thread.start()
    yield server
    end.set()
    thread.join(10.0)
    server.close()


@pytest.fixture
def driver(server: ControllerServer, limits: Limits, tmp_path: Path) -> ControllerDriver:
    motion, state, io = server.ports
    # Generous: other tests may share the machine's cores.
    site = ControllerSite(
        speed_cap=1.0,
        motion_port=motion,
        state_port=state,
        io_port=io,
        lead=0.4,
        late=0.3,
        pause=0.1,
    )
    return ControllerDriver(site, limits, command="test", lock_directory=tmp_path)


def commands(server: ControllerServer) -> list[int]:
    return [
        MotionControl.of(message).command
        for _, message in list(server.controller.messages)
        if message.type == MessageType.MOTION_CTRL
    ]


def ready(thread: DriverThread) -> None:
    assert thread.wait(lambda status: status.state == "ready", 10.0), thread.status


def test_it_runs_a_trajectory_in_real_time(
    driver: ControllerDriver, server: ControllerServer, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(1)
    with DriverThread(driver) as thread:
        ready(thread)
        thread.run(1, trajectory)
        assert thread.wait(lambda status: status.completed == 1, 30.0), thread.status
        assert thread.feedback is not None
        assert np.abs(thread.feedback.positions - trajectory.positions[-1]).max() < 1e-3
    assert thread.status.state == "offline"
    assert commands(server)[-2:] == [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
    assert server.controller.underruns == 0


def test_leaving_in_motion_holds_first(
    driver: ControllerDriver, server: ControllerServer, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    with pytest.raises(KeyboardInterrupt), DriverThread(driver) as thread:
        ready(thread)
        thread.run(1, trajectory)
        assert thread.wait(lambda status: status.progress > 0.3, 10.0)
        raise KeyboardInterrupt
    assert commands(server)[-2:] == [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
    assert Command.STOP_MOTION not in commands(server)
    assert server.controller.underruns == 0
    curve = trajectory.interpolant()(np.linspace(0.0, trajectory.duration, 20_000))
    assert np.abs(curve - server.controller.positions).max(axis=1).min() < 1e-3


def test_an_exception_in_the_loop_stops_the_robot(
    driver: ControllerDriver,
    server: ControllerServer,
    make_trajectory: TrajectoryMaker,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    broken = threading.Event()
    step = driver._step

    def fails(now: float) -> None:
        if broken.is_set():
            broken.clear()
            raise ZeroDivisionError("a bug")
        step(now)

    monkeypatch.setattr(driver, "_step", fails)
    with DriverThread(driver) as thread:
        ready(thread)
        thread.run(1, make_trajectory(3))
        assert thread.wait(lambda status: status.progress > 0.3, 10.0)
        broken.set()
        assert thread.wait(lambda status: status.state == "fault", 5.0)
        assert "ZeroDivisionError: a bug" in thread.status.reason
        assert thread.wait(lambda _: Command.STOP_MOTION in commands(server), 5.0)


def test_a_loop_that_fails_again_closes_the_connections(
    driver: ControllerDriver, server: ControllerServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(now: float) -> None:
        raise ZeroDivisionError("a bug")

    with DriverThread(driver) as thread:
        ready(thread)
        monkeypatch.setattr(driver, "_step", fails)
        assert thread.wait(lambda status: "failed again" in status.reason, 5.0), thread.status
        assert all(link.closed for link in driver.links.values())
    assert thread.status.state == "offline"


def test_nobody_there_and_a_second_owner(
    driver: ControllerDriver, limits: Limits, tmp_path: Path
) -> None:
    with DriverThread(driver) as thread:
        second = DriverThread(
            ControllerDriver(driver.site, limits, command="second", lock_directory=tmp_path)
        )
        with pytest.raises(HardwareError, match=r"in use: process \d+ \(test\)"):
            second.start()
        second.close()
        ready(thread)
    nobody = ControllerSite(motion_port=1, state_port=1, io_port=1)
    alone = ControllerDriver(nobody, limits, lock_directory=tmp_path)
    with pytest.raises(HardwareError, match=r"cannot connect to 127\.0\.0\.1:1 "):
        alone.connect()
    assert alone.status.state == "offline" and not alone.links
