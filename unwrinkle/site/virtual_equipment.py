"""Virtual controller of a site with virtual grippers and pan-tilt units, in real time."""

from math import exp

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.models.limits import Limits
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.simulation.controllers.controller import (
    VirtualController,
    VirtualControllerSettings,
)
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault
from unwrinkle.simulation.controllers.settings import Firmware
from unwrinkle.simulation.devices.digital_grippers import VirtualDigitalGrippers
from unwrinkle.simulation.devices.serial_pan_tilt import PtyPort, VirtualSerialPanTilt
from unwrinkle.systems.station.loopback.virtual_devices import unit_settings

_LONGEST_CATCH_UP_S = 1.0


class VirtualEquipment:
    """Virtual devices that `unwrinkle controller` runs.

    Attributes:
        controller, server: the virtual controller and its server.
        devices: serial ports of the pan-tilt units, left and right; empty without them.
        measured: (13,) measured positions of the axes, rad.
    """

    def __init__(
        self,
        site: Site,
        limits: Limits,
        start: ArrayLike,
        *,
        settings: VirtualControllerSettings | None = None,
        ports: tuple[int, int, int] | None = None,
        faults: tuple[ServerFault, ...] = (),
        lag: float = 0.0,
        cloth: bool = True,
        pan_tilt: bool = False,
    ) -> None:
        """Listen on the site's address and ports.

        Args:
            site: site whose equipment is simulated.
            limits: limits of the axes.
            start: (13,) initial positions, rad.
            settings: settings of the controller; those of the site if left out.
            ports: ports of motion, state and I/O instead of the site's; 0 for any free port.
            faults: faults of the server to simulate.
            lag: time constant of the axes behind the commands, in addition to the controller's
                delay, s; 0 for none.
            cloth: whether closed grippers hold cloth.
            pan_tilt: whether to simulate the pan-tilt units of the shipped head.

        Raises:
            HardwareError: a port is in use.
        """
        place = site.controller
        if settings is None:
            settings = VirtualControllerSettings.of_site(place)
        self.controller = VirtualController(
            settings, start, (limits.lower, limits.upper, limits.velocity)
        )
        site_ports = place.motion_port, place.state_port, place.io_port
        self.server = ControllerServer(
            self.controller, place.host, site_ports if ports is None else ports, faults
        )
        if settings.firmware == Firmware.OF_2013:  # it has no I/O server
            self.server.stop_listening("io")
        self.measured = self.controller.positions
        self._lag, self._cloth = lag, (cloth, cloth)
        self._grippers = VirtualDigitalGrippers(site.grippers)
        head = nominal_calibration().stereo_head(limits.head)
        self._units = [
            VirtualSerialPanTilt(unit_settings(eye.unit))
            for eye in (head.left, head.right)
            if pan_tilt
        ]
        self._serial = [PtyPort() for _ in self._units]
        self.devices = tuple(port.device for port in self._serial)
        self._now: float | None = None
        self._reported = self._state_texts()

    def step(self, now: float) -> list[str]:
        """Advance to a time of any monotonic clock, s; return one line for each event.

        A call that is late by up to a second sends the feedback that it missed: a robot moves and
        reports whether this computer is busy or not.
        """
        last = now if self._now is None else self._now
        period = self.controller.settings.feedback_period
        texts: list[str] = []
        if now - last <= _LONGEST_CATCH_UP_S:
            for missed in np.arange(last + period, now, period):
                texts += self._advance(float(missed))
        return texts + self._advance(now)

    def _advance(self, now: float) -> list[str]:
        step = 0.0 if self._now is None else max(now - self._now, 0.0)
        self._now = now
        before = self.measured
        share = 1.0 - exp(-step / self._lag) if self._lag > 0.0 else 1.0
        self.measured = before + share * (self.controller.axis_positions - before)
        speed = (self.measured - before) / step if step > 0.0 else np.zeros_like(before)
        self.controller.inputs |= self._grippers.update(now, self.controller.outputs, self._cloth)
        self.server.poll(now, self.measured, speed)
        for port, unit in zip(self._serial, self._units, strict=True):
            port.poll(unit, now)
        return self._changes()

    def close(self) -> None:
        """Close every port; repeated calls have no effect."""
        self.server.close()
        for port in self._serial:
            port.close()

    def _changes(self) -> list[str]:
        texts = [text for _, text in self.server.events]
        self.server.events.clear()
        now = self._state_texts()
        texts += [
            f"{name}: {value}" for name, value in now.items() if value != self._reported[name]
        ]
        self._reported = now
        return texts

    def _state_texts(self) -> dict[str, object]:
        """Return the values that are reported when they change."""
        controller = self.controller
        return {
            "mode": controller.pendant.mode,
            "remote": "on" if controller.pendant.remote else "off",
            "emergency stop": "pressed" if controller.pendant.e_stop else "released",
            "hold": "pressed" if controller.pendant.hold else "released",
            "alarm": controller.pendant.alarm or "none",
            "servos": "on" if controller.pendant.servo else "off",
            "trajectory mode": "on" if controller.pendant.trajectory_mode else "off",
            "axes": "move" if controller.moving else "rest",
            "queues that ran empty during motion": controller.underruns,
            "grippers (right, left)": ", ".join(
                "closed" if closed else "open" for closed in self._grippers.closed
            ),
            "connections refused for invalid data": len(self.server.rejected),
        }
