"""A simulated station with hands on its ports."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from unwrinkle.models.cloth import load_material
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.perception.head import Gaze
from unwrinkle.perception.head_file import nominal_calibration
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.cloth import Cloth, ClothState, Support
from unwrinkle.simulation.outlines import outline
from unwrinkle.systems.ports import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    HeadImage,
    TrajectoryCommand,
)
from unwrinkle.systems.sim_station import SimStation, build_sim_station

Array = NDArray[np.float64]


class Bench:
    """A station with a simulator; a small flat towel lies on its table."""

    def __init__(self, cell: Cell, state: ClothState | None = None, **options: Any) -> None:
        head = nominal_calibration().stereo_head(cell.limits.head)
        support = Support((0.0, -1.2), (0.8, 0.8), 0.70)
        cloth = Cloth(outline("towel", 32), load_material("terry"), support)
        self.station: SimStation = build_sim_station(
            cell, cloth, state or cloth.flat((0.0, -1.1)), head=head, seed=1, **options
        )
        self.simulator = Simulator(self.station)
        self.context = self.simulator.get_mutable_context()
        self.send("trajectory", TrajectoryCommand())
        self.send("gripper.command", GripperCommand())
        self.send("head.command", HeadCommand())
        self.station.GetInputPort("speed_override").FixValue(self.context, [1.0])
        self.simulator.Initialize()
        self.number = 0

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
    """The shipped cell with the smallest pictures."""
    scenario = load_scenario()
    scenario.sensor.scale = 0.125
    return load_cell(scenario)


@pytest.fixture
def make_bench(station_cell: Cell) -> Callable[..., Bench]:
    """Stations of that cell, with options of `build_sim_station`."""

    def make(cell: Cell = station_cell, **options: Any) -> Bench:
        return Bench(cell, **options)

    return make


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench()


@pytest.fixture
def swing() -> Callable[..., Trajectory]:
    """A smooth motion of one axis from a posture (13,), rad, and back to rest."""
    return _swing


def _swing(start: Array, axis: int = 1, way: float = 0.4, duration: float = 1.0) -> Trajectory:
    u = np.linspace(0.0, 1.0, 80)
    unit = np.zeros(13)
    unit[axis] = way
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration
    return Trajectory(duration * u, start + np.outer(share, unit), np.outer(rate, unit))
