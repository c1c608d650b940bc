"""Connect to a robot from a program.

A `Robot` checks and executes verified plans, without a terminal.
"""

import datetime
import logging
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from unwrinkle import __version__
from unwrinkle.execution.confirmation import check_confirmed
from unwrinkle.execution.controls import NoControls
from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.execution.finished_runs import FinishedRuns
from unwrinkle.execution.loop import run_to_the_end
from unwrinkle.execution.preflight import Preflight, preflight, recheck
from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.flattening.execution.state import ExecutionResult, Outcome
from unwrinkle.garbage import gc_disabled
from unwrinkle.hardware.equipment import Equipment, connected
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.interrupts import StopSignals
from unwrinkle.models.errors import HardwareError, InputError, UnwrinkleError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.site.sites import find_site, site_cell
from unwrinkle.site.virtual_process import virtual_controller

_log = logging.getLogger(__name__)


class Robot:
    """Connected controller and grippers of a site.

    Attributes:
        site: site of the devices.
        cell: cell in which plans are checked.
        equipment: driver and grippers.
    """

    def __init__(self, site: Site, cell: Cell, equipment: Equipment, log: RunLog) -> None:
        """Keep the connection that `connect` has made."""
        self.site, self.cell, self.equipment = site, cell, equipment
        self._log = log
        self._finished = FinishedRuns()
        self._stroke = 0  # number of the last command to the grippers

    @property
    def log(self) -> Path:
        """Return the file of the run log, with all points sent and all feedback measured."""
        return self._log.path

    def preflight(self, plan: FlatteningPlan, *, speed: float | None = None) -> Preflight:
        """Check everything that an execution requires; nothing is sent.

        Args:
            plan: plan to be executed.
            speed: share of the planned speed; the site's if left out.
        """
        self.equipment.settle()
        return preflight(
            plan,
            self.cell,
            self.site,
            *self.equipment.fresh_feedback(),
            speed=speed,
            grippers=self.equipment.gripper_report(),
            log=self.log,
            finished=self._finished,
        )

    def execute(
        self, plan: FlatteningPlan, *, speed: float | None = None, confirm: str = ""
    ) -> ExecutionResult:
        """Verify a plan from the robot's posture, and execute it to its end.

        Ctrl-C (SIGINT) and SIGTERM brake along the path; the signal's exception is raised once the
        robot is at rest.

        Args:
            plan: plan to be executed.
            speed: share of the planned speed; the site's if left out.
            confirm: six or more first characters of the plan's hash; not required for virtual
                equipment.

        Raises:
            InputError: the plan is not confirmed, or the site is under commissioning (use
                `unwrinkle execute`, which has the dead-man key).
            HardwareError: a preflight check failed and nothing was sent, or the execution did not
                reach its end.
            KeyboardInterrupt: SIGINT was received.
            SystemExit: SIGTERM was received.
        """
        if not isinstance(plan, FlatteningPlan):
            raise InputError(f"execute: got {type(plan).__name__}; give a `FlatteningPlan`")
        if speed is not None and not 0.0 < speed <= 1.0:
            raise InputError(f"execute: speed is {speed!r}; give a share above 0, up to 1")
        self._check_confirmed(plan, confirm)
        with ExitStack() as stack:
            stack.enter_context(gc_disabled())
            interrupts = stack.enter_context(StopSignals())
            checked = self.preflight(plan, speed=speed)
            problem = "" if checked.passed else checked.summary()
            problem = problem or recheck(
                checked, plan, self.cell, self.site, *self.equipment.fresh_feedback()
            )
            if problem:
                raise HardwareError(problem)
            interrupts.armed = True
            settings = ExecutionSettings.of_site(self.site)
            executor = PlanExecutor(
                self.equipment.driver,
                self.equipment.grippers,
                plan,
                settings.for_single_run(most_speed=checked.most_speed),
                speed=checked.speed,
                stroke=self._stroke,
                log=self._log,
            )
            try:
                result = run_to_the_end(executor, NoControls(), interrupts)
            finally:
                self._stroke = executor.state.gripper.number
        if result.outcome != Outcome.DONE:
            text = (
                f"{result.outcome} after {', '.join(result.finished) or 'no segment'}: "
                f"{result.reason}; a new plan from home is needed"
            )
            if interrupts.number == signal.SIGINT:
                raise KeyboardInterrupt(text)
            if interrupts.number:
                raise SystemExit(128 + interrupts.number)
            raise HardwareError(text)
        try:
            self._finished.add(self.site.name, plan.content_hash, checked.speed)
        except InputError as error:
            _log.warning("%s", error)
        return result

    def _check_confirmed(self, plan: FlatteningPlan, confirm: str) -> None:
        if self.site.virtual:
            return
        if self.site.commissioning:
            raise InputError(
                f"site {self.site.name} is under commissioning, which requires the dead-man key of "
                "`unwrinkle execute`"
            )
        check_confirmed(plan, str(confirm))


@contextmanager
def connect(
    site: str | Path, cell: Cell | None = None, *, log: str | Path | None = None
) -> Iterator[Robot]:
    """Connect to a site's controller and grippers; hold, disconnect and unlock at the end.

    For a site with virtual equipment, its virtual controller runs in a separate process meanwhile.

    Args:
        site: a shipped site (`loopback`), or a site's file.
        cell: cell in which plans are checked; the site's own if left out.
        log: file of the run log; `run-TIME.jsonl` in the working folder if left out.

    Raises:
        InputError: there is no such site, or the log cannot be written.
        HardwareError: a device does not answer, or another program drives the robot.
    """
    found = find_site(site)
    cell = site_cell(found) if cell is None else cell
    if not isinstance(cell, Cell):
        raise InputError(
            f"connect: got {type(cell).__name__}; give a cell, as `load_cell` returns it"
        )
    with ExitStack() as stack:
        if found.virtual:
            found = stack.enter_context(virtual_controller(str(site)))
        now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        path = Path(f"run-{now}.jsonl") if log is None else Path(log)
        header = {"version": __version__, "site": found.name, "axes": cell.robot.axes}
        run_log = stack.enter_context(RunLog.create(path, header))
        try:
            equipment = stack.enter_context(
                connected(found, cell, command="unwrinkle execute", log=run_log)
            )
        except UnwrinkleError:
            stack.close()
            path.unlink(missing_ok=True)  # it holds nothing but its header
            raise
        yield Robot(found, cell, equipment, run_log)
