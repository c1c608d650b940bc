"""Connect a site's controller and grippers for the duration of a block."""

import contextlib
import dataclasses as dc
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.hardware.controller_state import CONNECTING, OFFLINE, DriverStatus, JointFeedback
from unwrinkle.hardware.grippers.base import GripperReport, Grippers
from unwrinkle.hardware.grippers.factory import open_grippers
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site

#: Maximum time for the first complete feedback and status after connecting, s.
FIRST_FEEDBACK = 3.0
#: Maximum time for the grippers' first answer, s.
FIRST_ANSWER = 1.0
#: Maximum time for a new set of feedback, s.
FRESH = 0.5
#: Polling period, s.
_POLL_PERIOD = 0.01


@dataclass(frozen=True, eq=False)
class SiteEquipment:
    """Connected devices of a site.

    Attributes:
        site: site of the devices.
        driver: driver of the controller, in a process of its own.
        grippers: driver of the grippers; None if the site has none.
        clock: clock of the driver, s.
    """

    site: Site
    driver: DriverProcess
    grippers: Grippers | None
    clock: Callable[[], float]

    def settle(self, sleep: Callable[[float], None] = time.sleep) -> DriverStatus:
        """Wait until the driver has received feedback and the grippers have had time to answer.

        Returns:
            The driver's status, whatever it is by then.
        """
        begin = self.clock()
        while self.clock() - begin < FIRST_FEEDBACK:
            waited = self.clock() - begin
            if self.grippers is not None:
                self.grippers.poll(self.clock())
            seen = self.driver.status.state not in (OFFLINE, CONNECTING)
            if seen and (self.grippers is None or waited >= FIRST_ANSWER):
                break
            sleep(_POLL_PERIOD)
        return self.driver.status

    def fresh_feedback(
        self, sleep: Callable[[float], None] = time.sleep
    ) -> tuple[JointFeedback | None, DriverStatus, float]:
        """Wait for new feedback, for at most `FRESH` seconds.

        Returns:
            The last feedback, the driver's status, and the time of its clock, s.
        """
        begin, last = self.clock(), self.driver.feedback
        while self.clock() - begin < FRESH:
            feedback = self.driver.feedback
            if feedback is not None and feedback is not last:
                break
            sleep(_POLL_PERIOD)
        return self.driver.feedback, self.driver.status, self.clock()

    def gripper_report(self) -> GripperReport | None:
        """Return the grippers' report, with a reason if they do not answer.

        It is None if the site has no grippers.
        """
        if self.grippers is None:
            return None
        report, site = self.grippers.status, self.site.grippers
        silent = ""
        if site.kind == "digital":
            asked = [a for a in (*site.closed_input, *site.holding_input) if a]
            known = self.driver.inputs
            missing = [str(a) for a in asked if known.get(a) is None]
            if missing:
                why = self.driver.io_problem or "no answer"
                silent = f"the grippers' inputs {', '.join(missing)} cannot be read ({why})"
        elif report.opening is None:
            silent = f"no gripper answers on {site.interface} {site.channel}; is it powered?"
        return dc.replace(report, reason=report.reason or silent)


@contextlib.contextmanager
def connected(site: Site, cell: Cell, log: RunLog | None = None) -> Iterator[SiteEquipment]:
    """Connect to a site's controller and grippers; at the end hold, disconnect and unlock.

    Args:
        site: site of the devices.
        cell: cell with the limits of the robot's axes and the grippers' opening.
        log: run log of what is sent and measured.

    Raises:
        HardwareError: a device does not answer, or another program drives the robot.
    """
    path = None if log is None else log.path
    with DriverProcess(
        site.controller,
        cell.limits,
        log=path,
        command="unwrinkle execute",
        io=site.needs_io,
        full_speed=cell.with_speed(1.0).limits.velocity,
    ) as driver:
        if site.grippers.kind == "none":
            yield SiteEquipment(site, driver, None, time.monotonic)
            return
        grippers = open_grippers(site.grippers, driver, cell.scenario.gripper.opening)
        try:
            yield SiteEquipment(site, driver, grippers, time.monotonic)
        finally:
            grippers.close()
