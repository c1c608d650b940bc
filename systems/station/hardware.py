"""Station in its `hardware` form: the same ports, connected to the devices of a site.

A separate process polls the controller's driver on the computer's clock, so that feedback is
monitored and trajectories are streamed independently of the diagram's computing time. The diagram
must be advanced no faster than real time.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from unwrinkle.hardware.cameras.base import DepthCamera, PairCamera
from unwrinkle.hardware.equipment import Equipment, connected
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import StationForm
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.drivers.controller import ControllerDriverSystem
from unwrinkle.systems.station.drivers.depth_camera import DepthCameraDriverSystem
from unwrinkle.systems.station.drivers.device_clock import own_time
from unwrinkle.systems.station.drivers.grippers import GripperDriverSystem
from unwrinkle.systems.station.drivers.pair_camera import PairCameraSystem
from unwrinkle.systems.station.drivers.pan_tilt import PanTiltDriverSystem


class HardwareStation(Station):
    """Station of real devices; see `hardware_station`."""

    form = StationForm.HARDWARE

    def __init__(self, cell: Cell, equipment: Equipment, log: RunLog | None) -> None:
        """Connect the ports; see `hardware_station`."""
        super().__init__()
        self.cell, self.site = cell, equipment.site
        period = cell.scenario.station.feedback_period
        feedback = equipment.driver.feedback
        assert feedback is not None and equipment.grippers is not None
        builder = DiagramBuilder()
        driver = builder.AddSystem(
            ControllerDriverSystem(
                equipment.driver, feedback.positions, period=period, feedback_period=period
            )
        )
        grippers = builder.AddSystem(
            GripperDriverSystem(
                equipment.grippers,
                cell.scenario.gripper.opening,
                period=period,
                clock=own_time,
                open_first=True,
                log=log,
            )
        )
        head_command, head_position, cameras = _add_eyes(
            builder,
            cell,
            equipment,
            driver.GetOutputPort("position"),
            driver.GetOutputPort("velocity"),
        )
        for system, port, name in (
            (driver, "trajectory", "trajectory"),
            (grippers, "command", "gripper.command"),
            (driver, "speed_override", "speed_override"),
        ):
            builder.ExportInput(system.GetInputPort(port), name)
        builder.ExportInput(head_command, "head.command")
        builder.ExportOutput(head_position, "head.position_measured")
        for system, port, name in (
            (driver, "position", "joints.position_measured"),
            (driver, "velocity", "joints.velocity_measured"),
            (driver, "status", "controller.status"),
            (grippers, "status", "gripper.status"),
            (cameras, "left_image", "head.left_image"),
            (cameras, "right_image", "head.right_image"),
            (cameras, "depth_image", "depth_camera.image"),
        ):
            builder.ExportOutput(system.GetOutputPort(port), name)
        builder.BuildInto(self)
        self.set_name("station")


def _add_eyes(
    builder: DiagramBuilder,
    cell: Cell,
    equipment: Equipment,
    position: OutputPort,
    velocity: OutputPort,
) -> tuple[InputPort, OutputPort, PairCameraSystem | DepthCameraDriverSystem]:
    """Add the head with its two cameras, or the depth camera.

    Returns:
        Input port of head commands, output port of the head's angles, and the system with the three
        images.
    """
    period, cameras = cell.scenario.station.feedback_period, equipment.cameras
    if not equipment.pan_tilt:
        depth_camera = cast(DepthCamera, cameras)
        depth = builder.AddSystem(
            DepthCameraDriverSystem(cell, depth_camera, period=period, clock=own_time)
        )
        builder.Connect(velocity, depth.GetInputPort("velocity"))
        return depth.GetInputPort("command"), depth.GetOutputPort("head_position"), depth
    left, right = equipment.pan_tilt
    heads = builder.AddSystem(PanTiltDriverSystem(left, right, period=period, clock=own_time))
    pair = builder.AddSystem(
        PairCameraSystem(cast(PairCamera, cameras), period=period, clock=own_time)
    )
    for source, target in (
        (heads.GetOutputPort("status"), "head"),
        (position, "position"),
        (velocity, "velocity"),
    ):
        builder.Connect(source, pair.GetInputPort(target))
    return heads.GetInputPort("command"), heads.GetOutputPort("position"), pair


@contextmanager
def hardware_station(
    cell: Cell, site: Site, *, head: StereoHead, seed: int = 0, log: RunLog | None = None
) -> Iterator[HardwareStation]:
    """Open a site's devices and yield their station, a diagram called "station"; nothing moves yet.

    Args:
        cell: robot and cell; the scenario's sensor is the head, or a depth camera over the table.
        site: addresses and settings of the devices; see `preconditions`.
        head: calibrated stereo head; unused with a depth camera.
        seed: of the random numbers.
        log: run log of what is sent and measured.

    Raises:
        InputError: the site lacks a setting that a device needs.
        HardwareError: a device does not answer, or is not ready.
    """
    with connected(
        site,
        cell,
        command="the closed loop",
        log=log,
        limits=cell.with_speed(1.0).limits,
        head_steps=(head.left.unit.step, head.right.unit.step),
        cameras=True,
    ) as equipment:
        equipment.await_ready()
        station = HardwareStation(cell, equipment, log)
        station.head, station.seed = head, seed
        yield station
