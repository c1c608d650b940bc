"""One call of `unwrinkle execute`: connect, check, show, confirm, run, disconnect."""

import contextlib
import dataclasses as dc
import datetime
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from unwrinkle import __version__
from unwrinkle.execution.confirmation import CHARACTERS, check_confirmed
from unwrinkle.execution.controls import DEAD_MAN_KEY, KEYS, open_controls
from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.execution.finished_runs import FinishedRuns
from unwrinkle.execution.loop import run_to_the_end
from unwrinkle.execution.page import ExecutionPage
from unwrinkle.execution.preflight import Preflight, chosen_speed, preflight, recheck
from unwrinkle.flattening.execution.settings import ExecutionSettings
from unwrinkle.flattening.execution.state import ExecutionResult, Outcome
from unwrinkle.garbage import gc_disabled
from unwrinkle.hardware.equipment import Equipment, connected
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.interrupts import StopSignals
from unwrinkle.models.errors import HardwareError, InputError, NoVerifiedPlanError
from unwrinkle.models.io.files import write_text
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.site.queue_clearing import clear_confirmed
from unwrinkle.site.sites import find_site, site_cell
from unwrinkle.viewer.overlay import PreviewSummary
from unwrinkle.viewer.preview import preview_page
from unwrinkle.viewer.scene import start_meshcat

#: Width of a table outside a terminal, columns.
_WIDTH = 140
#: Margin of the proposed latency over the measured lag, s.
LATENCY_MARGIN = 0.03


@dataclass(frozen=True)
class ExecutionOptions:
    """Options of an execution.

    Attributes:
        plan: file of the plan.
        site: site file, or name of a shipped site.
        go: whether to move the robot.
        confirmation: first characters of the plan's hash, if given in advance.
        speed: share of the planned speed; None for the site's.
        log: file of the run log; None for a new one with `go`, and for none without.
        html: file of the preview page; None for none.
        live: whether to show the robot live.
        commands: file of instructions, `-` for standard input; None for the terminal's keys.
        clear_queue: whether to empty the controller's queues first, after confirmation.
    """

    plan: Path
    site: str
    go: bool = False
    confirmation: str | None = None
    speed: float | None = None
    log: Path | None = None
    html: Path | None = None
    live: bool = False
    commands: str | None = None
    clear_queue: bool = False


class ExecutionSession:
    """Prepare one execution; `run` carries it out."""

    def __init__(
        self,
        options: ExecutionOptions,
        *,
        console: Console | None = None,
        finished: FinishedRuns | None = None,
    ) -> None:
        """Read plan, site and cell; nothing is connected.

        Args:
            options: options of the user.
            console: console for the output.
            finished: record of finished runs; the user's own if left out.

        Raises:
            InputError: a file is missing or wrong, the plan is for another cell, or the
                confirmation is for another plan.
        """
        self._options = options
        self._console = Console() if console is None else console
        if not self._console.is_terminal:
            self._console.width = _WIDTH
        self._finished = FinishedRuns() if finished is None else finished
        self._site = find_site(options.site)
        self._cell = site_cell(self._site)
        self._plan = FlatteningPlan.load(options.plan)
        self._plan.check_made_for(self._cell)
        if options.confirmation is not None:
            check_confirmed(self._plan, options.confirmation)

    def run(self) -> int:
        """Execute the plan; without `go`, check and show it only.

        Returns:
            Number of the signal that ended it; 0 if none did.

        Raises:
            NoVerifiedPlanError: the plan is not verified.
            HardwareError: a check or a device failed, or the execution did not reach its end.
            InputError: a file cannot be written, or the plan was not confirmed.
        """
        options = self._options
        start = self._plan.segments[0].trajectory.positions[0]
        verdict = verify(self._plan, self._cell, start=start)
        if options.html is not None:
            page = preview_page(
                self._plan, self._cell, PreviewSummary.of(verdict), title=options.plan.name
            )
            write_text(options.html, page)
            self._say(f"page    {options.html}")
        if not verdict.passed:
            raise NoVerifiedPlanError(verdict.summary())
        speed = chosen_speed(self._site, self._plan, options.speed, self._finished)
        if options.clear_queue:
            clear_confirmed(self._site, self._console)
        path = self._log_path()
        with contextlib.ExitStack() as stack:
            stack.enter_context(gc_disabled())
            interrupts = stack.enter_context(StopSignals())
            log = None if path is None else stack.enter_context(self._create_log(path, speed))
            if path is not None:
                self._say(f"log     {path}")
            equipment = stack.enter_context(
                connected(self._site, self._cell, command="unwrinkle execute", log=log)
            )
            checked = self._check(equipment, speed, path)
            if log is not None:
                self._log_checks(log, checked, equipment.clock())
            if not checked.passed:
                raise HardwareError(checked.summary())
            if not options.go:
                self._say("dry run: nothing was sent; --go moves the robot")
                return 0
            assert log is not None
            self._confirm(checked)
            # From here until the equipment is disconnected, a signal must not interrupt the
            # motion's end.
            interrupts.armed = True
            result = self._execute(equipment, checked, interrupts, log)
            self._say_lag(equipment.driver.status.lag)
        return self._end(result, checked, interrupts)

    def _log_path(self) -> Path | None:
        if self._options.log is not None or not self._options.go:
            return self._options.log
        now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
        return Path(f"run-{now}-{self._plan.content_hash[:CHARACTERS]}.jsonl")

    def _create_log(self, path: Path, speed: float) -> RunLog:
        header: dict[str, Any] = {
            "version": __version__,
            "site": self._site.name,
            "controller": dc.asdict(self._site.controller),
            "scenario": self._site.scenario,
            "plan_file": str(self._options.plan.resolve()),
            "plan_hash": self._plan.content_hash,
            "axes": self._cell.robot.axes,
            "speed": speed,
            "go": self._options.go,
        }
        return RunLog.create(path, header)

    def _check(self, equipment: Equipment, speed: float, path: Path | None) -> Preflight:
        equipment.settle()
        checked = preflight(
            self._plan,
            self._cell,
            self._site,
            *equipment.fresh_feedback(),
            speed=speed,
            grippers=equipment.gripper_report(),
            log=path,
            finished=self._finished,
        )
        if checked.banner:
            self._console.print(f"[bold]{checked.banner}[/bold]", highlight=False)
        table = Table(title="Preflight", title_justify="left", box=box.SIMPLE)
        for column in ("check", "result", "what was found"):
            table.add_column(column, no_wrap=column != "what was found")
        for check in checked.checks:
            table.add_row(
                check.name, "pass" if check.passed else "[bold red]FAIL[/bold red]", check.text
            )
        self._console.print(table)
        return checked

    def _log_checks(self, log: RunLog, checked: Preflight, now: float) -> None:
        verdict = checked.verdict
        log.event(
            now,
            "preflight",
            checked.summary(),
            passed=checked.passed,
            checks=[dc.asdict(check) for check in checked.checks],
            verdict=None if verdict is None else verdict.to_json(),
        )

    def _confirm(self, checked: Preflight) -> None:
        """Ask for the first characters of the plan's hash, unless they were given in advance.

        Raises:
            InputError: they are wrong or missing.
        """
        assert checked.verdict is not None
        near = checked.verdict.smallest
        clearance = "no two bodies come near each other"
        if near is not None:
            clearance = (
                f"smallest clearance {1e3 * near.distance:.1f} mm, {' and '.join(near.bodies)}"
            )
        self._say(f"plan    {self._plan.content_hash}")
        self._say(f"        {clearance}; {checked.speed:.0%} of the planned speed")
        if self._options.confirmation is not None:
            return
        self._say("The robot will move. Keep clear of it, with the emergency stop in reach.")
        prompt = f"Type the first {CHARACTERS} characters of the plan's hash to go: "
        try:
            typed = self._console.input(prompt)
        except EOFError:
            raise InputError(
                "the motion was not confirmed: there is no terminal; type the hash, or give --yes"
            ) from None
        check_confirmed(self._plan, typed)

    def _execute(
        self, equipment: Equipment, checked: Preflight, interrupts: StopSignals, log: RunLog
    ) -> ExecutionResult:
        driver, site = equipment.driver, self._site
        page = None
        if self._options.live:
            meshcat = start_meshcat()
            page = ExecutionPage(self._plan, self._cell, meshcat, lambda: driver.feedback)
            self._say(f"live    {meshcat.web_url()}")
        again = recheck(
            checked,
            self._plan,
            self._cell,
            site,
            *equipment.fresh_feedback(),
        )
        if again:
            raise HardwareError(again)
        settings = ExecutionSettings.of_site(site).for_single_run(
            most_speed=checked.most_speed, attended=True, dead_man=site.commissioning
        )
        executor = PlanExecutor(
            driver, equipment.grippers, self._plan, settings, speed=checked.speed, log=log
        )
        with open_controls(self._options.commands) as controls:
            self._say(f"keys: {KEYS}" + (f"; {DEAD_MAN_KEY}" if site.commissioning else ""))
            return run_to_the_end(executor, controls, interrupts, page=page, tell=self._say)

    def _say_lag(self, lag: float) -> None:
        """Print the robot's lag, and the latency to set if the lag is close to its limit."""
        if lag <= 0.0:
            return
        latency = self._site.controller.latency
        text = (
            f"lag     {1e3 * lag:.0f} ms from a command to its feedback; "
            f"controller.latency is {latency:g} s"
        )
        proposed = math.ceil(50.0 * (lag + LATENCY_MARGIN)) / 50.0
        if self._site.commissioning or lag > 0.9 * latency:
            text += f"; set it to {proposed:.2f}"
        self._say(text)

    def _end(self, result: ExecutionResult, checked: Preflight, interrupts: StopSignals) -> int:
        if result.outcome != Outcome.DONE:
            if interrupts.number:
                self._say(f"{result.outcome}: {result.reason}; the robot is at rest")
                return interrupts.number
            raise HardwareError(
                f"{result.outcome} after {', '.join(result.finished) or 'no segment'}: "
                f"{result.reason}; make a new plan from home"
            )
        self._say(f"done: {', '.join(result.finished)}")
        try:
            self._finished.add(self._site.name, self._plan.content_hash, checked.speed)
        except InputError as error:
            self._say(f"note: {error}")
        return 0

    def _say(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True, markup=False)
