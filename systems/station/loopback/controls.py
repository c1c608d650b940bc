"""Station in its `loopback` form.

The real drivers, over TCP and serial lines, against virtual devices.

Robot, cameras and cloth are simulated as in the `sim` form, with the same `truth` outputs. The
connection is real: trajectories pass through the controller's driver, its messages, and the virtual
controller, whose joints drive the plant; grippers are commanded by the controller's digital
outputs; the head by ASCII commands on pseudo-terminals. Both ends of every connection run on the
simulation's clock, so a run is reproducible and as fast as the simulation.
"""

import dataclasses as dc
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller_state import READY
from unwrinkle.hardware.grippers.digital_io import DigitalGrippers
from unwrinkle.hardware.grippers.factory import needs_io
from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import open_serial
from unwrinkle.hardware.run_log.protocol import RunLogger
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer
from unwrinkle.simulation.devices.serial_pan_tilt import VirtualSerialPanTilt
from unwrinkle.systems.station.drivers.controller import ControllerDriverSystem
from unwrinkle.systems.station.drivers.grippers import GripperDriverSystem
from unwrinkle.systems.station.drivers.pan_tilt import PanTiltDriverSystem
from unwrinkle.systems.station.loopback.lockstep import ControllerLockstep, PanTiltLockstep
from unwrinkle.systems.station.loopback.virtual_devices import (
    VirtualControllerSystem,
    VirtualPanTiltSystem,
    unit_settings,
)
from unwrinkle.systems.station.world import ControlsBuilder, StationControls, World

#: Time for which the devices run before time 0 so that they get ready, s on the simulation's clock.
_STARTUP_TIME = 3.0


class LoopbackDevices:
    """Drivers and virtual devices of a loopback station; `controls` connects them to its ports.

    Attributes:
        driver: driver of the controller.
        server: server of the virtual controller.
        controller: the virtual controller.
    """

    def __init__(
        self, cell: Cell, site: Site, start: Array, head: StereoHead, log: RunLogger | None
    ) -> None:
        """Start the virtual controller and connect the driver to it.

        Raises:
            HardwareError: the connection cannot be made.
        """
        self._head, self._log = head, log
        settings = cell.scenario.station
        limits = cell.with_speed(1.0).limits
        self.controller = VirtualController(
            dc.replace(
                VirtualControllerSettings.of_site(site.controller), period=settings.plant_step
            ),
            start,
            (limits.lower, limits.upper, limits.velocity),
        )
        self.server = ControllerServer(self.controller, site.controller.host, (0, 0, 0))
        ports = dict(zip(("motion_port", "state_port", "io_port"), self.server.ports, strict=True))
        self._site = dc.replace(site, controller=dc.replace(site.controller, **ports))
        self.driver = ControllerDriver(
            self._site.controller, limits, log=log, io=needs_io(site.grippers)
        )
        self._lockstep = ControllerLockstep(self.driver, self.server)
        self._units: VirtualPanTiltSystem | None = None
        self.driver.connect()

    def controls(self, builder: DiagramBuilder, world: World) -> StationControls:
        """Add the systems of the devices; see `world.StationControls`."""
        settings, site = world.cell.scenario.station, self._site
        heads = self._heads(world)
        self._start_up(world, settings.plant_step)
        driver = builder.AddSystem(
            ControllerDriverSystem(
                self.driver,
                world.start,
                period=settings.plant_step,
                feedback_period=settings.feedback_period,
                poll=self._lockstep.poll_driver,
            )
        )
        controller = builder.AddSystem(
            VirtualControllerSystem(
                self.controller, site.grippers, self._poll_server, period=settings.plant_step
            )
        )
        grippers = builder.AddSystem(
            GripperDriverSystem(
                DigitalGrippers(site.grippers, self.driver),
                world.cell.scenario.gripper.opening,
                period=settings.feedback_period,
                log=self._log,
            )
        )
        assert self._units is not None
        builder.AddSystem(self._units)
        builder.AddSystem(heads)
        for source, target in (
            (world.measured["position"], controller.GetInputPort("position")),
            (world.measured["velocity"], controller.GetInputPort("velocity")),
            (driver.GetOutputPort("number"), controller.GetInputPort("number")),
            (world.grippers.GetOutputPort("status"), controller.GetInputPort("grippers")),
            (controller.GetOutputPort("gripper_command"), world.grippers.GetInputPort("command")),
            (world.units.GetOutputPort("status"), self._units.GetInputPort("status")),
            (self._units.GetOutputPort("command"), world.units.GetInputPort("command")),
        ):
            builder.Connect(source, target)
        return StationControls(
            inputs={
                "trajectory": driver.GetInputPort("trajectory"),
                "gripper.command": grippers.GetInputPort("command"),
                "head.command": heads.GetInputPort("command"),
                "speed_override": driver.GetInputPort("speed_override"),
            },
            outputs={
                "joints.position_measured": driver.GetOutputPort("position"),
                "joints.velocity_measured": driver.GetOutputPort("velocity"),
                "controller.status": driver.GetOutputPort("status"),
                "gripper.status": grippers.GetOutputPort("status"),
                "head.position_measured": heads.GetOutputPort("position"),
            },
            desired=controller.GetOutputPort("desired"),
            reference=controller.GetOutputPort("reference"),
            head=heads.GetOutputPort("status"),
        )

    def close(self) -> None:
        """Leave trajectory mode, disconnect, and stop the virtual devices."""
        self.driver.close()
        self.server.close()
        if self._units is not None:
            self._units.close()

    def _poll_server(self, now: float, positions: Array, velocities: Array) -> None:
        self._lockstep.poll_server(now, lambda: self.server.poll(now, positions, velocities))

    def _heads(self, world: World) -> PanTiltDriverSystem:
        """Build the virtual units on pseudo-terminals, and the drivers at the other ends."""
        eyes = (self._head.left, self._head.right)
        settings = unit_settings(eyes[0].unit)
        period = world.cell.scenario.station.feedback_period
        start = world.units.GetOutputPort("position").Eval(world.units.CreateDefaultContext())
        self._units = VirtualPanTiltSystem(
            [eye.unit.step for eye in eyes],
            start,
            lambda motor: VirtualSerialPanTilt(settings, mechanics=motor),
            period=period,
        )
        drivers, steps = [], []
        for eye, port in zip(eyes, self._units.ports, strict=True):
            line = open_serial(port.device, self._site.pan_tilt.baud)
            driver = PanTiltDriver(line, self._site.pan_tilt, eye.unit.step, eye.name)
            drivers.append(driver)
            steps.append(PanTiltLockstep(driver, line, port))

        def poll(now: float) -> None:
            for each in steps:
                each.poll(now)

        self._poll_heads = poll
        return PanTiltDriverSystem(drivers[0], drivers[1], period=period, poll=poll)

    def _start_up(self, world: World, step: float) -> None:
        """Run the devices before time 0 until they are ready.

        Raises:
            HardwareError: the virtual controller is not ready.
        """
        assert self._units is not None
        rest = np.zeros(13)
        count = round(_STARTUP_TIME / step)
        for index in range(-count, 0):
            now = index * step
            self._lockstep.poll_driver(now)
            self._poll_server(now, world.start, rest)
            self._units.poll(now)
            self._poll_heads(now)
        if self.driver.status.state != READY:
            status = self.driver.status
            raise HardwareError(
                f"the virtual controller was not ready after {_STARTUP_TIME:g} s: "
                f"{status.reason or status.state}"
            )


@contextmanager
def loopback_controls(
    cell: Cell, site: Site, start: Array, *, head: StereoHead, log: RunLogger | None = None
) -> Iterator[ControlsBuilder]:
    """Connect the drivers to virtual devices, and yield a builder of controls that go through them.

    Args:
        cell: robot and cell.
        site: settings of the drivers; the operating system chooses the ports.
        start: (13,) initial posture of the axes, rad.
        head: true stereo head.
        log: run log of what is sent and measured.

    Raises:
        HardwareError: the devices do not get ready.
    """
    devices = LoopbackDevices(cell, site, start, head, log)
    try:
        yield devices.controls
    finally:
        devices.close()
