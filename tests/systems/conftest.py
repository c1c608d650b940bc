"""Stations with test inputs at their ports."""

import dataclasses as dc
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    HeadImage,
    TrajectoryCommand,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.cloth import load_material
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.models.site import CameraSite, PanTiltSite, loopback_site
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.site.virtual_equipment import VirtualEquipment
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.factory import make_station
from unwrinkle.testing.table import TABLE


class Bench:
    """A station with a simulator; a small flat towel lies on its table."""

    def __init__(self, cell: Cell, state: ClothState | None = None, **options: Any) -> None:
        head = nominal_calibration().stereo_head(cell.limits.head)
        cloth = Cloth(outline("towel", 32), load_material("terry"), TABLE)
        self.devices = ExitStack()
        self.station = self.devices.enter_context(
            self._made(
                cell,
                cloth=cloth,
                state=state or cloth.flat((0.0, -1.1)),
                head=head,
                seed=1,
                **options,
            )
        )
        self.simulator = Simulator(self.station)
        self.context = self.simulator.get_mutable_context()
        self.send("trajectory", TrajectoryCommand())
        self.send("gripper.command", GripperCommand())
        self.send("head.command", HeadCommand())
        self.station.GetInputPort("speed_override").FixValue(self.context, [1.0])
        self.simulator.Initialize()
        self.number = 0

    def _made(self, cell: Cell, **options: Any) -> AbstractContextManager[Station]:
        return make_station(cell, form="sim", **options)

    def send(self, port: str, command: Any) -> None:
        self.station.GetInputPort(port).FixValue(self.context, Value(command))

    def go(self, duration: float) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + duration)

    def read(self, port: str) -> Any:
        return self.station.GetOutputPort(port).Eval(self.context)

    def run(self, trajectory: Trajectory | None, duration: float | None = None) -> ControllerStatus:
        self.number += 1
        self.send("trajectory", TrajectoryCommand(self.number, trajectory, "motion"))
        if duration is None:
            duration = 0.2 + (0.0 if trajectory is None else trajectory.duration)
        self.go(duration)
        status: ControllerStatus = self.read("controller.status")
        return status

    def grip(self, right: bool, left: bool, duration: float = 0.75) -> GripperStatus:
        self.number += 1
        self.send("gripper.command", GripperCommand(self.number, (right, left)))
        self.go(duration)
        status: GripperStatus = self.read("gripper.status")
        return status

    def look(self, gaze: Gaze, duration: float = 1.0) -> HeadImage:
        self.number += 1
        self.send("head.command", HeadCommand(self.number, gaze))
        self.go(duration)
        image: HeadImage = self.read("head.left_image")
        return image


@pytest.fixture(scope="session")
def station_cell() -> Cell:
    """Return the shipped cell with the smallest pictures."""
    scenario = load_scenario()
    scenario.sensor.scale = 0.125
    return load_cell(scenario)


@pytest.fixture
def make_bench(station_cell: Cell) -> Callable[..., Bench]:
    """Return a function that builds stations of that cell."""

    def make(cell: Cell = station_cell, **options: Any) -> Bench:
        return Bench(cell, **options)

    return make


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench()


@pytest.fixture
def swing() -> Callable[..., Trajectory]:
    """Return a smooth motion of one axis from a posture (13,), rad, that ends at rest."""
    return _swing


def _swing(start: Array, axis: int = 1, way: float = 0.4, duration: float = 1.0) -> Trajectory:
    u = np.linspace(0.0, 1.0, 80)
    unit = np.zeros(13)
    unit[axis] = way
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration
    return Trajectory(duration * u, start + np.outer(share, unit), np.outer(rate, unit))


class Rig(Bench):
    """Station of any form with numbered commands."""

    def __init__(self, form: str, cell: Cell, folder: Path) -> None:
        self._form, self._devices = form, None
        if form == "hardware":
            self._devices = Devices(cell, folder)
        super().__init__(cell)

    def _made(self, cell: Cell, **options: Any) -> AbstractContextManager[Station]:
        if self._devices is None:
            return make_station(cell, form=self._form, **options)
        return make_station(
            cell, form=self._form, site=self._devices.site, head=options["head"], go=True
        )

    @property
    def simulated(self) -> bool:
        return self._devices is None

    @property
    def time(self) -> float:
        return float(self.context.get_time())

    def go(self, duration: float) -> None:
        if self._devices is None:
            super().go(duration)
            return
        for _ in range(max(round(duration / 0.025), 1)):
            begin = time.monotonic()
            super().go(0.025)
            time.sleep(max(0.0, 0.025 - (time.monotonic() - begin)))

    def send_motion(self, trajectory: Trajectory | None) -> int:
        self.number += 1
        self.resend(self.number, trajectory)
        return self.number

    def resend(self, number: int, trajectory: Trajectory | None) -> None:
        self.send("trajectory", TrajectoryCommand(number, trajectory, "motion"))

    def send_grip(self, closed: tuple[bool, bool]) -> int:
        self.number += 1
        self.send("gripper.command", GripperCommand(self.number, closed))
        return self.number

    def send_look(self, gaze: Gaze) -> int:
        self.number += 1
        self.send("head.command", HeadCommand(self.number, gaze))
        return self.number

    def override(self, value: float) -> None:
        self.station.GetInputPort("speed_override").FixValue(self.context, [value])

    def close(self) -> None:
        self.devices.close()
        if self._devices is not None:
            self._devices.close()


class Devices:
    """Run virtual equipment in a thread, in real time, with a folder of pairs."""

    def __init__(self, cell: Cell, folder: Path) -> None:
        site = loopback_site()
        start = cell.robot.named_states["home"]
        self._equipment = VirtualEquipment(site, cell.limits, start, ports=(0, 0, 0), pan_tilt=True)
        names = ("motion_port", "state_port", "io_port")
        ports = dict(zip(names, self._equipment.server.ports, strict=True))
        self.site = dc.replace(
            site,
            controller=dc.replace(site.controller, **ports),
            pan_tilt=PanTiltSite(*self._equipment.devices),
            cameras=CameraSite("folder", folder=str(folder)),
        )
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            self._equipment.server.wait(0.002)
            self._equipment.step(time.monotonic())

    def close(self) -> None:
        self._over.set()
        self._thread.join(5.0)
        self._equipment.close()


@pytest.fixture
def make_rig(station_cell: Cell) -> Callable[..., Rig]:
    """Return a function that makes stations of every form.

    A folder of pairs replaces real cameras.
    """
    return lambda form, folder: Rig(form, station_cell, folder)
