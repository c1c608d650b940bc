"""A site's controller and grippers, connected for as long as a block lasts, and left clean whatever happens in it."""

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

#: s for the first whole feedback and status after the connection, and for the grippers' first answer.
FIRST_FEEDBACK, FIRST_ANSWER = 3.0, 1.0
#: s in which a new set of feedback comes, if any does.
FRESH = 0.5
_POLL = 0.01


@dataclass(frozen=True, eq=False)
class Equipment:
    """What is connected.

    Attributes:
        site: whose it is.
        driver: of the controller, in a process of its own.
        grippers: None where the site has none.
        clock: that the driver runs on, s.
    """

    site: Site
    driver: DriverProcess
    grippers: Grippers | None
    clock: Callable[[], float]

    def settle(self, sleep: Callable[[float], None] = time.sleep) -> DriverStatus:
        """Wait until the driver has seen the robot and the grippers have had time to answer.

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
            sleep(_POLL)
        return self.driver.status

    def fresh_feedback(
        self, sleep: Callable[[float], None] = time.sleep
    ) -> tuple[JointFeedback | None, DriverStatus, float]:
        """Wait for a set of feedback that comes from now on, for a short while at most.

        Returns:
            The last set, the driver's status, and the time now on its clock, s.
        """
        begin, last = self.clock(), self.driver.feedback
        while self.clock() - begin < FRESH:
            feedback = self.driver.feedback
            if feedback is not None and feedback is not last:
                break
            sleep(_POLL)
        return self.driver.feedback, self.driver.status, self.clock()

    def gripper_report(self) -> GripperReport | None:
        """What the grippers say; a report without a word of them has a reason. None where the site has none."""
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
                silent = f"the inputs {', '.join(missing)} of the grippers cannot be read ({why})"
        elif report.opening is None:
            silent = f"no gripper answers on {site.interface} {site.channel}; is it powered?"
        return dc.replace(report, reason=report.reason or silent)


@contextlib.contextmanager
def connected(site: Site, cell: Cell, log: RunLog | None = None) -> Iterator[Equipment]:
    """Connect to a site's controller and grippers; at the end hold, disconnect and unlock.

    Args:
        site: whose.
        cell: for the limits of the robot's axes, and the grippers' opening.
        log: takes what is sent and measured.

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
            yield Equipment(site, driver, None, time.monotonic)
            return
        grippers = open_grippers(site.grippers, driver, cell.scenario.gripper.opening)
        try:
            yield Equipment(site, driver, grippers, time.monotonic)
        finally:
            grippers.close()
