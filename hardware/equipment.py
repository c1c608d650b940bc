"""Connected devices of a site, opened for the duration of a block."""

import contextlib
import dataclasses as dc
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from unwrinkle.hardware.cameras.base import DepthCamera, PairCamera
from unwrinkle.hardware.cameras.factory import is_depth_camera, make_cameras, make_depth_camera
from unwrinkle.hardware.controller.base import Driver
from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.hardware.controller_state import (
    CONNECTING,
    OFFLINE,
    READY,
    DriverStatus,
    JointFeedback,
)
from unwrinkle.hardware.grippers.base import GripperReport, Grippers
from unwrinkle.hardware.grippers.factory import make_grippers, needs_io
from unwrinkle.hardware.pan_tilt.base import PanTilt
from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import open_serial
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.limits import Limits
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import NO_DEVICE, PanTiltSite, Site

#: Longest wait for the first complete feedback and status after connecting, s.
_FIRST_FEEDBACK_S = 3.0
#: Time that the grippers have for their first answer, s.
_FIRST_ANSWER_S = 1.0
#: Longest wait for a new set of feedback, s.
_FRESH_S = 0.5
#: Between two polls, s.
_POLL_PERIOD_S = 0.01

Sleep = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Equipment:
    """Connected devices of a site.

    Attributes:
        site: of the devices.
        driver: of the controller.
        grippers: both grippers; None if the site has none.
        cameras: the head's pair, or the depth camera; None where they were not asked for.
        pan_tilt: the head's units, left and right; empty where they were not asked for.
        clock: of the devices, s.
    """

    site: Site
    driver: Driver
    grippers: Grippers | None = None
    cameras: PairCamera | DepthCamera | None = None
    pan_tilt: tuple[PanTilt, ...] = ()
    clock: Callable[[], float] = time.monotonic

    def settle(self, sleep: Sleep = time.sleep) -> DriverStatus:
        """Wait until the driver has received feedback and the grippers have had time to answer.

        Returns:
            The driver's status, whatever it is by then.
        """
        begin = self.clock()
        while self.clock() - begin < _FIRST_FEEDBACK_S:
            waited = self.clock() - begin
            if self.grippers is not None:
                self.grippers.poll(self.clock())
            seen = self.driver.status.state not in (OFFLINE, CONNECTING)
            if seen and (self.grippers is None or waited >= _FIRST_ANSWER_S):
                break
            sleep(_POLL_PERIOD_S)
        return self.driver.status

    def await_ready(self, sleep: Sleep = time.sleep) -> None:
        """Poll until the controller and the head are ready for the first command.

        Raises:
            HardwareError: a device is not ready in time.
        """
        site = self.site
        end = self.clock() + site.controller.connect_timeout + 10.0 * site.pan_tilt.reply_timeout
        while problems := self._problems():
            if self.clock() > end:
                raise HardwareError("; ".join(problems))
            for unit in self.pan_tilt:
                unit.poll(self.clock())
            sleep(_POLL_PERIOD_S)

    def _problems(self) -> list[str]:
        status = self.driver.status
        found = []
        if status.state != READY or self.driver.feedback is None:
            found.append(f"the controller is {status.state}: {status.reason or 'no feedback yet'}")
        return found + [
            f"{unit.name} is not ready: {unit.status.reason or unit.status.state}"
            for unit in self.pan_tilt
            if not unit.status.still
        ]

    def fresh_feedback(
        self, sleep: Sleep = time.sleep
    ) -> tuple[JointFeedback | None, DriverStatus, float]:
        """Wait for new feedback, for at most half a second.

        Returns:
            The last feedback, the driver's status, and the time of its clock, s.
        """
        begin, last = self.clock(), self.driver.feedback
        while self.clock() - begin < _FRESH_S:
            feedback = self.driver.feedback
            if feedback is not None and feedback is not last:
                break
            sleep(_POLL_PERIOD_S)
        return self.driver.feedback, self.driver.status, self.clock()

    def gripper_report(self) -> GripperReport | None:
        """Return the grippers' report, with a reason if they cannot be commanded; None without
        grippers.
        """
        if self.grippers is None:
            return None
        report = self.grippers.status
        return dc.replace(report, reason=report.reason or self.grippers.problem)


@contextlib.contextmanager
def connected(
    site: Site,
    cell: Cell,
    *,
    command: str,
    log: RunLog | None = None,
    limits: Limits | None = None,
    head_steps: tuple[float | None, float | None] = (None, None),
    cameras: bool = False,
) -> Iterator[Equipment]:
    """Connect to a site's devices; at the end hold, wait for rest, disconnect and unlock.

    Args:
        site: of the devices.
        cell: with the limits of the axes and the grippers' opening.
        command: owner of the lock, shown to another program that finds the robot in use.
        log: run log of what is sent and measured.
        limits: of the axes; those of the cell if left out.
        head_steps: angle of a step of the left and the right pan-tilt unit in the head's
            calibration, rad; None accepts what a unit reports.
        cameras: whether to open the cameras, and with a pair of them the head.

    Raises:
        InputError: the site lacks a setting that a device needs.
        HardwareError: a device does not answer, or another program drives the robot.
    """
    full_speed = cell.with_speed(1.0).limits.velocity
    driver = DriverProcess(
        site.controller,
        cell.limits if limits is None else limits,
        log=None if log is None else log.path,
        command=command,
        io=needs_io(site.grippers),
        full_speed=full_speed,
    )
    # Closed after the robot, which may have to come to rest first.
    with contextlib.ExitStack() as after, driver:
        grippers: Grippers | None = None
        eyes: PairCamera | DepthCamera | None = None
        units: list[PanTilt] = []
        if site.grippers.kind != NO_DEVICE:
            grippers = make_grippers(site.grippers, driver, cell.scenario.gripper.opening)
            after.callback(grippers.close)
        if cameras and is_depth_camera(site.cameras):
            eyes = after.enter_context(contextlib.closing(make_depth_camera(site.cameras)))
        elif cameras:
            for name, device, step in zip(
                ("left", "right"),
                (site.pan_tilt.left, site.pan_tilt.right),
                head_steps,
                strict=True,
            ):
                unit = _open_unit(name, device, site.pan_tilt, step)
                after.callback(unit.close)
                units.append(unit)
            eyes = after.enter_context(contextlib.closing(make_cameras(site.cameras)))
        yield Equipment(site, driver, grippers, eyes, tuple(units))


def _open_unit(eye: str, device: str, site: PanTiltSite, step: float | None) -> PanTilt:
    return PanTiltDriver(
        open_serial(device, site.baud), site, step, f"{eye} pan-tilt unit ({device})"
    )
