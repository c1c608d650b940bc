"""The driver in a process of its own: the same promises, and an end with whoever started it."""

import dataclasses as dc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.hardware.controller_state import FAULT, HELD, OFFLINE, READY, RUNNING
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import ConnectionLostError, InUseError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.limits import Limits, load_limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer

pytestmark = pytest.mark.alone


class Robot:
    """A virtual controller in a thread, in real time."""

    def __init__(self, limits: Limits) -> None:
        self.controller = VirtualController(
            VirtualControllerSettings(), np.zeros(13), (limits.lower, limits.upper, limits.velocity)
        )
        self.server = ControllerServer(self.controller)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            self.server.wait(0.002)
            self.server.poll(time.monotonic())

    def rests(self, deadline: float = 10.0) -> bool:
        end = time.monotonic() + deadline
        while self._moves() and time.monotonic() < end:
            time.sleep(0.01)
        return not self._moves()

    def _moves(self) -> bool:
        controller = self.controller
        return bool(controller.velocities.any() or controller.axis_velocities.any())

    def close(self) -> None:
        self._over.set()
        self._thread.join(5.0)
        self.server.close()


@pytest.fixture
def limits() -> Limits:
    return load_limits(models_dir() / "limits.yaml")


@pytest.fixture
def robot(limits: Limits) -> Iterator[Robot]:
    robot = Robot(limits)
    yield robot
    robot.close()


@pytest.fixture
def site(robot: Robot) -> ControllerSite:
    motion, state, io = robot.server.ports
    return ControllerSite(motion_port=motion, state_port=state, io_port=io)


def _swing(duration: float = 2.0) -> Trajectory:
    u = np.linspace(0.0, 1.0, round(duration / 0.008) + 1)
    unit = np.zeros(13)
    unit[8] = 0.5
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration
    return Trajectory(duration * u, np.outer(share, unit), np.outer(rate, unit))


def test_it_runs_holds_and_resumes_while_this_process_is_busy(
    site: ControllerSite, limits: Limits, robot: Robot, tmp_path: Path
) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog.create(path, {}) as log, DriverProcess(site, limits, log=path) as driver:
        assert driver.pid not in (None, os.getpid())
        assert driver.wait(lambda status: status.state == READY, 5.0)
        feedback = driver.feedback
        assert feedback is not None and feedback.count > 0
        driver.run(1, _swing(), "swing")
        log.event(time.monotonic(), "test", "written by this process")
        assert driver.wait(lambda status: status.state == RUNNING and status.progress > 0.5, 5.0)
        driver.hold(2)
        assert driver.wait(lambda status: status.state == HELD, 5.0)
        driver.resume(3)
        assert driver.wait(lambda status: status.completed == 3, 8.0), driver.status
        assert robot.controller.positions[8] == pytest.approx(0.5, abs=1e-4)
        assert robot.controller.underruns == 0
    assert driver.status.state == OFFLINE
    records = read_run_log(path)
    assert not records.cut and len(records.commanded.times) > 150
    assert {"test", "run", "hold"} <= {event.kind for event in records.events}


def test_nobody_there_and_a_robot_in_use_are_named(
    site: ControllerSite, limits: Limits, robot: Robot
) -> None:
    nowhere = dc.replace(site, state_port=1, connect_timeout=0.5)
    with pytest.raises(ConnectionLostError, match=r"127\.0\.0\.1:1 "):
        DriverProcess(nowhere, limits).start()
    with DriverProcess(site, limits, command="the first") as first:
        assert first.status.state != OFFLINE
        with pytest.raises(InUseError) as refusal:
            DriverProcess(site, limits).start()
        assert "the first" in refusal.value.owner


def test_a_dead_driver_is_a_fault_and_the_robot_rests(
    site: ControllerSite, limits: Limits, robot: Robot
) -> None:
    with DriverProcess(site, limits) as driver:
        assert driver.wait(lambda status: status.state == READY, 5.0)
        driver.run(1, _swing(3.0))
        assert driver.wait(lambda status: status.progress > 0.3, 5.0)
        assert driver.pid is not None
        os.kill(driver.pid, signal.SIGKILL)
        status = driver.status
        assert status.state == FAULT and "process has ended" in status.reason
        assert "press HOLD on the pendant before anything connects" in status.reason
        driver.run(2, _swing())  # and stays one
        assert driver.status.state == FAULT
    # The controller keeps what is in its queues.
    assert robot.rests() and sum(robot.controller.queued) > 0


def test_a_driver_that_is_asked_to_end_leaves_nothing_in_the_queues(
    site: ControllerSite, limits: Limits, robot: Robot
) -> None:
    with DriverProcess(site, limits) as driver:
        assert driver.wait(lambda status: status.state == READY, 5.0)
        driver.run(1, _swing(3.0))
        assert driver.wait(lambda status: status.progress > 0.3, 5.0)
        assert driver.pid is not None
        os.kill(driver.pid, signal.SIGTERM)
        assert driver.wait(lambda status: status.state == FAULT, 10.0)
        reason = driver.status.reason
        assert "it braked, and left the controller" in reason and "HOLD" not in reason
    assert robot.rests() and sum(robot.controller.queued) == 0


_PARENT = """
import sys, time, numpy as np
from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.models.limits import load_limits
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import Trajectory
u = np.linspace(0.0, 1.0, 626)
unit = np.zeros(13); unit[8] = 0.5
q = np.outer(u**3 * (10.0 - 15.0 * u + 6.0 * u * u), unit)
v = np.outer(30.0 * u**2 * (1.0 - u) ** 2 / 5.0, unit)
ports = [int(port) for port in sys.argv[1:]]
site = ControllerSite(motion_port=ports[0], state_port=ports[1], io_port=ports[2])
driver = DriverProcess(site, load_limits(models_dir() / "limits.yaml"))
driver.start()
driver.wait(lambda status: status.state == "ready", 5.0)
driver.run(1, Trajectory(5.0 * u, q, v))
driver.wait(lambda status: status.progress > 1.0, 10.0)
print("moving", flush=True)
time.sleep(60.0)
"""


def test_a_program_that_dies_leaves_a_robot_that_braked_and_was_left_cleanly(
    robot: Robot,
) -> None:
    command = [sys.executable, "-c", _PARENT, *map(str, robot.server.ports)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None and program.stdout.readline() == "moving\n"
        program.kill()
        program.wait(5.0)
    end = time.monotonic() + 10.0
    while robot.controller.pendant.trajectory_mode and time.monotonic() < end:
        time.sleep(0.02)
    assert not robot.controller.pendant.trajectory_mode and robot.rests()
    assert robot.controller.underruns == 0  # it braked along the path
    assert 0.01 < robot.controller.positions[8] < 0.45
