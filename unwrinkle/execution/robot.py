"""A connected robot for programs: preflight and execution of verified plans, without a terminal."""

import datetime
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from unwrinkle import __version__
from unwrinkle.execution.controls import Instruction
from unwrinkle.execution.executor import DONE, ExecutionResult, PlanExecutor
from unwrinkle.execution.finished_runs import FinishedRuns
from unwrinkle.execution.loop import Interrupts, run_to_the_end
from unwrinkle.execution.preflight import Preflight, last_look, preflight
from unwrinkle.garbage import collected_at_rest
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.site.equipment import Equipment, connected
from unwrinkle.site.sites import find_site, site_cell
from unwrinkle.site.virtual_process import virtual_controller

#: Characters of a plan's hash that confirm it on a robot.
_CONFIRMATION = 6


class Robot:
    """A site's controller and grippers, connected.

    Attributes:
        site: whose they are.
        cell: that plans are checked in.
        equipment: driver and grippers.
    """

    def __init__(self, site: Site, cell: Cell, equipment: Equipment, log: RunLog) -> None:
        """Keep what `connect` has connected."""
        self.site, self.cell, self.equipment = site, cell, equipment
        self._log = log
        self._finished = FinishedRuns()

    @property
    def log(self) -> Path:
        """File of the run log: all points sent and all feedback measured."""
        return self._log.path

    def preflight(self, plan: FlatteningPlan, *, speed: float | None = None) -> Preflight:
        """Check everything that an execution needs; nothing is sent.

        Args:
            plan: to be executed.
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
        """Verify a plan from where the robot stands, and execute it to its end.

        Ctrl-C and SIGTERM brake along the path.

        Args:
            plan: to be executed.
            speed: share of the planned speed; the site's if left out.
            confirm: the first six characters of the plan's hash, or more; not needed where the equipment is virtual.

        Raises:
            InputError: the plan is not confirmed, or the site is being commissioned (use `unwrinkle execute`, which has
                the dead-man key).
            HardwareError: a preflight check failed, nothing was sent; or the execution did not come to its end.
        """
        self._check_confirmed(plan, confirm)
        with ExitStack() as stack:
            stack.enter_context(collected_at_rest())
            interrupts = stack.enter_context(Interrupts())
            checked = self.preflight(plan, speed=speed)
            problem = "" if checked.passed else checked.summary()
            problem = problem or last_look(
                checked, plan, self.cell, self.site, *self.equipment.fresh_feedback()
            )
            if problem:
                raise HardwareError(problem)
            interrupts.armed = True
            executor = PlanExecutor(
                self.equipment.driver,
                self.equipment.grippers,
                plan,
                speed=checked.speed,
                most_speed=checked.most_speed,
                log=self._log,
            )
            result = run_to_the_end(executor, _NoControls(), interrupts)
        if result.outcome != DONE:
            raise HardwareError(
                f"{result.outcome} after {', '.join(result.finished) or 'no segment'}: {result.reason}; "
                "a new plan from home is needed"
            )
        self._finished.add(self.site.name, plan.content_hash, checked.speed)
        return result

    def _check_confirmed(self, plan: FlatteningPlan, confirm: str) -> None:
        if self.site.virtual:
            return
        if self.site.commissioning:
            raise InputError(
                f"site {self.site.name} is being commissioned, which needs the dead-man key of "
                "`unwrinkle execute`"
            )
        text = confirm.strip().lower()
        if len(text) < _CONFIRMATION or not plan.content_hash.startswith(text):
            raise InputError(
                f"the plan is not confirmed: give confirm=... with the first {_CONFIRMATION} characters of "
                f"its hash, {plan.content_hash[:_CONFIRMATION]}; nothing was sent"
            )


@contextmanager
def connect(
    site: str | Path, cell: Cell | None = None, *, log: str | Path | None = None
) -> Iterator[Robot]:
    """Connect to a site's controller and grippers; hold, disconnect and unlock at the end.

    Where the site's equipment is virtual, its virtual controller is started, in a process of its own, and ended.

    Args:
        site: a shipped site (`loopback`), or a site's file.
        cell: that plans are checked in; the site's own if left out.
        log: file of the run log; `run-TIME.jsonl` in the working folder if left out.

    Raises:
        InputError: there is no such site, or the log cannot be written.
        HardwareError: a device does not answer, or another program drives the robot.
    """
    found = find_site(site)
    cell = site_cell(found) if cell is None else cell
    with ExitStack() as stack:
        if found.virtual:
            found = stack.enter_context(virtual_controller(str(site)))
        now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        path = Path(f"run-{now}.jsonl") if log is None else Path(log)
        header = {"version": __version__, "site": found.name, "axes": cell.robot.axes}
        run_log = stack.enter_context(RunLog.create(path, header))
        equipment = stack.enter_context(connected(found, cell, run_log))
        yield Robot(found, cell, equipment, run_log)


class _NoControls:
    """No operator at a terminal."""

    def read(self) -> list[Instruction]:
        """Return no instruction."""
        return []
