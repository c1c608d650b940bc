"""The station in its `hardware` form: the same ports, wired to a site's devices.

A process of its own polls the controller's driver on the computer's own clock, so that feedback is watched and
trajectories are streamed whatever the rest of the diagram computes. The diagram itself has to run no faster than time does.
"""

import time

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

#: The devices are polled with this period while they get ready, s.
_POLL = 0.01


class Equipment:
    """A site's devices, opened; `close` them after use.

    Attributes:
        driver: of the controller, in a process of its own.
        grippers, camera: polled by the station.
        units: of the head, left and right; none where a depth camera sees.
    """

    def __init__(
        self, cell: Cell, site: Site, head: StereoHead, log: RunLog | None, grab: Grab
    ) -> None:
        """Open everything, and wait until it is ready; nothing moves.

        Raises:
            InputError: the site lacks what a station needs.
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
        try:
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
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hold, disconnect and close, in that order; a second time changes nothing."""
        opened, self._opened = self._opened, []
        for device in opened:  # the robot first: it may have to come to rest
            device.close()
        for line in self._lines:
            line.close()

    def _get_ready(self, site: Site) -> None:
        """Poll until every device says that it is ready.

        Raises:
            HardwareError: one of them does not, within its own deadline.
        """
        most = site.controller.connect_timeout + 10.0 * site.pan_tilt.reply_timeout
        end = own_time() + most
        while own_time() < end:
            for unit in self.units:
                unit.poll(own_time())
            problems = self._problems()
            if not problems:
                return
            time.sleep(_POLL)
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
    """A station of real devices. Build it with `build_hardware_station`, and `close` it after use.

    Attributes:
        equipment: its devices.
    """

    def __init__(self, cell: Cell, equipment: Equipment, log: RunLog | None) -> None:
        """See `build_hardware_station`."""
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
        InputError: with the keys that are missing, or the wrong kind of camera.
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
            f"cameras.kind of site {site.name} is 'openni2', a depth camera, but the scenario's sensor is the "
            "head; use --sensor xtion, or give cameras of the head"
        )


def _add_eyes(
    builder: DiagramBuilder,
    cell: Cell,
    equipment: Equipment,
    position: OutputPort,
    velocity: OutputPort,
) -> tuple[InputPort, OutputPort, PairCameraSystem | DepthCameraDriverSystem]:
    """The head with its two cameras, or the depth camera.

    Returns:
        Where head commands go to, what says where the head stands, and the system with the three images.
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
        cell: the robot in its cell; its scenario's sensor is the head, or a depth camera over the table.
        site: where the devices are.
        head: as calibrated; not needed by a depth camera.
        log: takes what is sent and measured.
        grab: takes a frame of the depth camera.

    Raises:
        InputError: the site lacks a device, or its cameras are of another kind than the scenario's sensor.
        HardwareError: a device does not answer, or is not ready.
    """
    equipment = Equipment(cell, site, head, log, grab)
    try:
        return HardwareStation(cell, equipment, log)
    except BaseException:
        equipment.close()
        raise
