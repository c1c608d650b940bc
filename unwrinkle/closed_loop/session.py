"""A run with its folder.

Begin or resume it, carry it out, and finish the folder whatever happens.
"""

import dataclasses as dc
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unwrinkle import __version__
from unwrinkle.closed_loop.recorder import Recorder
from unwrinkle.closed_loop.run import FlatteningRun, RunEnding, Watcher, failure
from unwrinkle.closed_loop.setup import (
    Loop,
    loop_around,
    open_loop,
    scenario_text,
    with_choices,
)
from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import RunStatus
from unwrinkle.flattening.state_machine import Approve
from unwrinkle.garbage import gc_disabled
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.interrupts import StopSignals
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import Scenario, StationForm, load_scenario
from unwrinkle.models.site import Site
from unwrinkle.report.page import write_report
from unwrinkle.report.replay import write_replay
from unwrinkle.runs.folder import RunFolder, RunSettings, command_line
from unwrinkle.simulation.cloth.cloth import ClothState
from unwrinkle.systems.station.base import Station

_log = logging.getLogger(__name__)

#: Choices that may change when a run is resumed.
_FREE = ("arms", "actions")


@dataclass(frozen=True)
class Choices:
    """Choices of the user; None takes the scenario's value.

    See `RunSettings` and `LoopSettings`.
    """

    garment: str | None = None
    start: str | None = None
    texture: str | None = None
    seed: int | None = None
    sensor: str | None = None
    scale: float | None = None
    arms: str | None = None
    mode: str | None = None
    actions: int | None = None
    station: str | None = None
    order: str | None = None

    def applied(self, scenario: Scenario) -> Scenario:
        """Return a scenario with these choices.

        Raises:
            InputError: no scenario can have such a choice.
        """
        choices = {name: value for name, value in dc.asdict(self).items() if name != "seed"}
        return with_choices(scenario, **choices)


@dataclass(frozen=True, eq=False)
class Session:
    """A loop and the folder of its record.

    Attributes:
        loop: station and diagram.
        folder: of the record.
        log: of the controller, if the station has one.
        devices: closed at the end of the run.
    """

    loop: Loop
    folder: RunFolder
    log: RunLog | None = None
    devices: ExitStack = field(default_factory=ExitStack)

    def run(
        self, watchers: tuple[Watcher, ...] = (), left: Callable[[], bool] = lambda: False
    ) -> RunEnding:
        """Run to the end, and finish the folder and its report.

        SIGINT or SIGTERM ends the run with the arms at rest. The station's devices are closed in
        every case.

        Args:
            watchers: observers, called after every period.
            left: whether the last viewer has left; a run that moves a robot then ends as if
                interrupted.

        Raises:
            Exception: an error that ended the run, after the arms came to rest and the folder was
                finished.
        """
        clock = time.perf_counter()
        recorder = Recorder(self.folder, self.loop.station.cell)
        with (
            StopSignals(armed=True, second_raises=True) as interrupts,
            ExitStack() as at_end,
        ):
            if self.loop.station.real:
                at_end.enter_context(gc_disabled())
            if self.log is not None:
                at_end.callback(self.log.close)
            at_end.enter_context(self.devices)
            run = FlatteningRun(self.loop, (recorder, *watchers))
            try:
                ending = run.run(
                    lambda: bool(interrupts.name) or (self.loop.station.real and left())
                )
            except BaseException as error:
                status, reason = failure(error)
                if isinstance(error, KeyboardInterrupt):
                    status, reason = RunStatus.INTERRUPTED, "interrupted twice"
                self._finish(status, reason, clock, run)
                raise
            reason = f"{interrupts.name}: {ending.reason}" if interrupts.name else ending.reason
            self._log_result(ending.status, reason, run)
            self._finish(ending.status, reason, clock, run)
        return ending

    def _log_result(self, status: str, reason: str, run: FlatteningRun) -> None:
        if self.log is not None:
            now = time.monotonic() if self.loop.station.real else run.station.time
            with suppress(OSError):
                self.log.event(now, "result", reason, outcome=status)

    def _finish(self, status: str, reason: str, clock: float, run: FlatteningRun) -> None:
        """Write the result; what cannot be written is logged only."""
        earlier = self.folder.figures.get("seconds", 0.0)
        figures: dict[str, Any] = {
            "actions": run.supervisor_state.policy_state.actions,
            "looks": run.supervisor_state.policy_state.looks,
            "seconds": earlier + time.perf_counter() - clock,
            **(run.station.truth() or {}),
        }
        pages = (
            lambda: self.folder.finish(status, reason, figures),
            lambda: write_report(self.folder),
            lambda: write_replay(self.folder, self.loop.station.cell),
        )
        for write in pages:
            try:
                write()
            except InputError as error:
                _log.error("%s", error)


def begin_run(
    choices: Choices,
    scenario: Path | None,
    out: Path | None,
    *,
    settings: Sequence[str] = (),
    site: Site | None = None,
    approve: Approve | None = None,
) -> Session:
    """Begin a run.

    Args:
        choices: choices of the user.
        scenario: scenario file; the shipped one if left out.
        out: folder of the run; if left out, a new one named after the garment and the seed.
        settings: changes of the scenario, e.g. `("loop.mode=paper",)`; the choices win over them.
        site: devices of the station.
        approve: callback that asks the operator about each verified plan; None approves every plan.

    Raises:
        InputError: an input is bad, or the folder holds a run already or cannot be written.
        HardwareError: a device of the station does not get ready.
    """
    chosen = choices.applied(load_scenario(_cell_of(site, scenario), settings=settings))
    seed = choices.seed or 0
    outline = chosen.station.garment.outline
    path = _unused(Path("out") / f"flatten-{outline}-{seed}") if out is None else out
    RunFolder.check_free(path)
    log = _log_of(chosen, path, site)
    with ExitStack() as on_failure:
        on_failure.callback(_discard, log)
        devices = on_failure.enter_context(ExitStack())
        loop = devices.enter_context(
            open_loop(chosen, seed=seed, site=site, log=log, approve=approve)
        )
        on_failure.pop_all()
    folder = RunFolder.create(path, _settings(chosen, seed))
    _save_cloth(folder, loop)
    return Session(loop, folder, log, devices)


def begin_run_on(station: Station, out: Path, *, approve: Approve | None = None) -> Session:
    """Begin a run on a station, which its maker closes.

    Args:
        station: of any form.
        out: folder of the run.
        approve: see `begin_run`; required by a station that moves a robot.

    Raises:
        InputError: the folder holds a run already or cannot be written, or nobody approves plans.
    """
    RunFolder.check_free(out)
    loop = loop_around(station, approve=approve)
    scenario = station.cell.scenario
    chosen = dc.replace(scenario, station=dc.replace(scenario.station, form=str(station.form)))
    folder = RunFolder.create(out, _settings(chosen, station.seed))
    _save_cloth(folder, loop)
    return Session(loop, folder)


def resume_run(
    run: Path, choices: Choices, *, site: Site | None = None, approve: Approve | None = None
) -> Session:
    """Resume a run from the state of the cloth and of the policy after its last complete look.

    Args:
        run: folder of the run.
        choices: only arms and actions may change.
        site, approve: see `begin_run`.

    Raises:
        InputError: the folder is no run, the run is flat, something else was chosen, or a file is
            damaged.
        HardwareError: a device of the station does not get ready.
    """
    fixed = [
        f"--{field.name}"
        for field in dc.fields(choices)
        if field.name not in _FREE and getattr(choices, field.name) is not None
    ]
    if fixed:
        raise InputError(f"{', '.join(fixed)}: cannot change when a run is resumed; leave it out")
    folder = RunFolder.open(run)
    if folder.status == RunStatus.FLAT:
        raise InputError(f"{run}: the run is flat already; begin a new run")
    scenario = choices.applied(load_scenario(folder.path / "scenario.yaml"))
    last = folder.last_complete()
    state = policy_state = None
    if last is not None:
        look = folder.look(last)
        policy_state = PolicyState.from_json(look.action().memory)
        if scenario.station.form != StationForm.HARDWARE:
            state = ClothState.load(look.after_file)
    log = _log_of(scenario, folder.path, site)
    with ExitStack() as on_failure:
        on_failure.callback(_discard, log)
        devices = on_failure.enter_context(ExitStack())
        loop = devices.enter_context(
            open_loop(
                scenario,
                seed=folder.settings.seed,
                state=state,
                policy_state=policy_state,
                site=site,
                log=log,
                approve=approve,
            )
        )
        on_failure.pop_all()
    folder.resume()
    _save_cloth(folder, loop)
    return Session(loop, folder, log, devices)


def _cell_of(site: Site | None, scenario: Path | None) -> Path | None:
    """Return the scenario file: plans must be verified in the cell of the site's robot.

    Raises:
        InputError: the site names its cell, and another one was given.
    """
    if site is None or not site.scenario:
        return scenario
    own = Path(site.scenario)
    if scenario is not None and scenario.resolve() != own.resolve():
        raise InputError(
            f"--scenario {scenario}: site {site.name} is in the cell of {own}; leave --scenario out"
        )
    return own


def _log_of(scenario: Scenario, path: Path, site: Site | None) -> RunLog | None:
    """Create a log in a run's folder if the station has a controller driver."""
    if scenario.station.form == StationForm.SIM:
        return None
    count = len(list(path.glob("controller-*.jsonl"))) if path.is_dir() else 0
    form = scenario.station.form
    name = form if site is None else site.name
    header: dict[str, Any] = {"version": __version__, "station": form, "site": name}
    if form == StationForm.LOOPBACK:
        header["clock"] = 0.0  # its times are those of the simulation
    return RunLog.create(path / f"controller-{count + 1}.jsonl", header)


def _discard(log: RunLog | None) -> None:
    """Delete the log of a run that did not begin."""
    if log is not None:
        log.close()
        log.path.unlink(missing_ok=True)
        with suppress(OSError):
            log.path.parent.rmdir()


def _settings(scenario: Scenario, seed: int) -> RunSettings:
    garment, sensor, loop = scenario.station.garment, scenario.sensor, scenario.loop
    return RunSettings(
        garment=garment.outline,
        texture=garment.texture,
        start=garment.start,
        seed=seed,
        sensor=sensor.depth_camera if sensor.kind == "depth" else sensor.kind,
        scale=sensor.scale,
        arms=loop.arms,
        mode=loop.mode,
        actions=loop.actions,
        scenario=scenario_text(scenario),
        command=command_line(),
    )


def _save_cloth(folder: RunFolder, loop: Loop) -> None:
    if loop.station.cloth is not None:
        folder.save_cloth(loop.station.cloth.triangles, loop.station.cloth.rest)


def _unused(path: Path) -> Path:
    """Return the path, or the path with the first free number appended."""
    candidate, count = path, 1
    while candidate.exists():
        count += 1
        candidate = path.with_name(f"{path.name}-{count}")
    return candidate
