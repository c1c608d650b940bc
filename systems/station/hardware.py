"""Station in its `hardware` form: the same ports, connected to the devices of a site.

A separate process polls the controller's driver on the computer's clock, so that feedback is
monitored and trajectories are streamed independently of the diagram's computing time. The diagram
must be advanced no faster than real time.
"""

import time
from contextlib import ExitStack

from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort

from unwrinkle.hardware.cameras.base import PairCamera
from unwrinkle.hardware.cameras.factory import open_cameras
from unwrinkle.hardware.cameras.openni import Grab, OpenNi2Camera, grab_openni2
from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.hardware.controller_state import READY
from unwrinkle.hardware.grippers.base import Grippers
from unwrinkle.hardware.grippers.factory import open_grippers
from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import open_serial
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.systems.station.drivers.controller import ControllerDriverSystem
from unwrinkle.systems.station.drivers.depth_camera import DepthCameraDriverSystem
from unwrinkle.systems.station.drivers.device_clock import own_time
from unwrinkle.systems.station.drivers.grippers import GripperDriverSystem
from unwrinkle.systems.station.drivers.pair_camera import PairCameraSystem
from unwrinkle.systems.station.drivers.pan_tilt import PanTiltDriverSystem

#: Polling period of the devices while they get ready, s.
_POLL_PERIOD = 0.01


class StationEquipment:
    """Open devices of a site; `close` them after use.

    Attributes:
        driver: driver of the controller, in a process of its own.
        grippers, camera: devices that the station polls.
        units: pan-tilt units of the head, left and right; empty if the sensor is a depth camera.
    """

    def __init__(
        self, cell: Cell, site: Site, head: StereoHead, log: RunLog | None, grab: Grab
    ) -> None:
        """Open all devices and wait until they are ready; nothing moves.

        Raises:
            InputError: the site lacks a device that the station needs.
            HardwareError: a device does not get ready.
        """
        stereo = cell.scenario.sensor.kind == "stereo"
        _check_complete(site, stereo=stereo)
        self._opened: list[PairCamera | OpenNi2Camera | DriverProcess | Grippers] = []
        self._lines = []
        limits = cell.with_speed(1.0).limits
        self.driver = DriverProcess(
            site.controller,
            limits,
            log=None if log is None else log.path,
            command="the closed loop",
            io=site.needs_io,
        )
        self._opened.append(self.driver)
        with ExitStack() as on_failure:
            on_failure.callback(self.close)
            self.driver.start()
            self.grippers: Grippers = open_grippers(site.grippers, self.driver)
            self._opened.append(self.grippers)
            self.units: list[PanTiltDriver] = []
            eyes = ((head.left, site.pan_tilt.left), (head.right, site.pan_tilt.right))
            for eye, device in eyes if stereo else ():
                line = open_serial(device, site.pan_tilt.baud)
                self._lines.append(line)
                name = f"{eye.name} pan-tilt unit ({device})"
                self.units.append(PanTiltDriver(line, site.pan_tilt, eye.unit.step, name))
            self.camera: PairCamera | OpenNi2Camera = (
                open_cameras(site.cameras) if stereo else OpenNi2Camera(site.cameras, grab)
            )
            self._opened.append(self.camera)
            self._get_ready(site)
            on_failure.pop_all()

    def close(self) -> None:
        """Hold, disconnect and close, in that order; repeated calls have no effect."""
        opened, self._opened = self._opened, []
        for device in opened:  # the robot first: it may have to come to rest
            device.close()
        for line in self._lines:
            line.close()

    def _get_ready(self, site: Site) -> None:
        """Poll until every device is ready.

        Raises:
            HardwareError: a device is not ready in time.
        """
        most = site.controller.connect_timeout + 10.0 * site.pan_tilt.reply_timeout
        end = own_time() + most
        while own_time() < end:
            for unit in self.units:
                unit.poll(own_time())
            problems = self._problems()
            if not problems:
                return
            time.sleep(_POLL_PERIOD)
        raise HardwareError("; ".join(problems))

    def _problems(self) -> list[str]:
        status = self.driver.status
        found = []
        if status.state != READY or self.driver.feedback is None:
            found.append(f"the controller is {status.state}: {status.reason or 'no feedback yet'}")
        found += [
            f"{unit.name} is not ready: {unit.status.reason or unit.status.state}"
            for unit in self.units
            if not unit.status.still
        ]
        return found


class HardwareStation(Diagram):
    """Station of real devices. Build it with `build_hardware_station`, and `close` it after use.

    Attributes:
        equipment: devices of the station.
    """

    def __init__(self, cell: Cell, equipment: StationEquipment, log: RunLog | None) -> None:
        """Connect the ports; see `build_hardware_station`."""
        super().__init__()
        self.equipment = equipment
        period = cell.scenario.station.feedback_period
        feedback = equipment.driver.feedback
        assert feedback is not None
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

    def close(self) -> None:
        """Hold, disconnect and close."""
        self.equipment.close()


def _check_complete(site: Site, *, stereo: bool) -> None:
    """Refuse a site that lacks what the closed loop needs.

    Raises:
        InputError: keys are missing, or the cameras are of the wrong kind.
    """
    needed = {
        "cameras.kind": site.cameras.kind.replace("none", ""),
        "grippers.kind": site.grippers.kind.replace("none", ""),
    }
    if stereo:
        needed |= {"pan_tilt.left": site.pan_tilt.left, "pan_tilt.right": site.pan_tilt.right}
    lacking = sorted(key for key, value in needed.items() if not value)
    if lacking:
        raise InputError(f"site {site.name}: the closed loop needs {', '.join(lacking)}")
    if not stereo and site.cameras.kind != "openni2":
        raise InputError(
            f"the scenario's sensor is a depth camera, but cameras.kind of site {site.name} is "
            f"'{site.cameras.kind}'; give openni2, or use --sensor stereo"
        )
    if stereo and site.cameras.kind == "openni2":
        raise InputError(
            f"cameras.kind of site {site.name} is 'openni2', a depth camera, but the scenario's "
            "sensor is the head; use --sensor xtion, or give cameras of the head"
        )


def _add_eyes(
    builder: DiagramBuilder,
    cell: Cell,
    equipment: StationEquipment,
    position: OutputPort,
    velocity: OutputPort,
) -> tuple[InputPort, OutputPort, PairCameraSystem | DepthCameraDriverSystem]:
    """Add the head with its two cameras, or the depth camera.

    Returns:
        Input port of head commands, output port of the head's angles, and the system with the three
        images.
    """
    period, camera = cell.scenario.station.feedback_period, equipment.camera
    if isinstance(camera, OpenNi2Camera):
        depth = builder.AddSystem(
            DepthCameraDriverSystem(cell, camera, period=period, clock=own_time)
        )
        builder.Connect(velocity, depth.GetInputPort("velocity"))
        return depth.GetInputPort("command"), depth.GetOutputPort("head_position"), depth
    heads = builder.AddSystem(PanTiltDriverSystem(*equipment.units, period=period, clock=own_time))
    pair = builder.AddSystem(PairCameraSystem(camera, period=period, clock=own_time))
    for source, target in (
        (heads.GetOutputPort("status"), "head"),
        (position, "position"),
        (velocity, "velocity"),
    ):
        builder.Connect(source, pair.GetInputPort(target))
    return heads.GetInputPort("command"), heads.GetOutputPort("position"), pair


def build_hardware_station(
    cell: Cell,
    site: Site,
    *,
    head: StereoHead,
    log: RunLog | None = None,
    grab: Grab = grab_openni2,
) -> HardwareStation:
    """Open a site's devices and build the station, a diagram called "station"; nothing moves yet.

    Args:
        cell: robot and cell; the scenario's sensor is the head, or a depth camera over the table.
        site: addresses and settings of the devices.
        head: calibrated stereo head; unused with a depth camera.
        log: run log of what is sent and measured.
        grab: function that takes a frame of the depth camera.

    Raises:
        InputError: the site lacks a device, or its cameras do not fit the scenario's sensor.
        HardwareError: a device does not answer, or is not ready.
    """
    with ExitStack() as on_failure:
        equipment = StationEquipment(cell, site, head, log, grab)
        on_failure.callback(equipment.close)
        station = HardwareStation(cell, equipment, log)
        on_failure.pop_all()
    return station
