"""``unwrinkle flatten``: run the closed loop, from a crumpled garment to a flat one."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from unwrinkle.closed_loop.run import RunEnding
    from unwrinkle.closed_loop.session import Session
    from unwrinkle.execution.confirmation import Confirmation
    from unwrinkle.models.site import Site

#: Exit codes by the run's status, beside 2 for bad input.
EXIT_CODES = {"flat": 0, "stopped": 3, "fault": 1, "interrupted": 130}

EXAMPLES = (
    "unwrinkle flatten --garment towel --sensor xtion --seed 1",
    "unwrinkle flatten --station loopback --site loopback --actions 3 --set loop.grasp_attempts=1",
)


def flatten(
    garment: Annotated[
        str | None,
        typer.Option(help="towel, dishcloth, tshirt or trousers (default: the scenario's)."),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            help="bunched, ridge, pinched, dropped, flat, or folded: corner, edge, pressed, pushed "
            "or twice (default: the scenario's)."
        ),
    ] = None,
    texture: Annotated[
        str | None, typer.Option(help="terry, print or plain (default: the scenario's).")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of all random numbers (default: 0).")
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="stereo, xtion, tof, or truth: the simulated cloth (default: the scenario's)."
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Scale of the head's pictures: 1 (16 megapixels), 0.5, 0.25 or 0.125."),
    ] = None,
    arms: Annotated[
        str | None,
        typer.Option(help="any (two if possible), dual or single (default: the scenario's)."),
    ] = None,
    mode: Annotated[
        str | None,
        typer.Option(
            help="Pull distance: foot (all slack), paper or between (default: the scenario's)."
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            help="First by volume, pull, height, length or together (default: the scenario's)."
        ),
    ] = None,
    actions: Annotated[
        int | None, typer.Option(min=0, help="Maximum number of actions (default: the scenario's).")
    ] = None,
    station: Annotated[
        str | None,
        typer.Option(
            help="sim, loopback (drivers, virtual devices) or hardware (default: the scenario's)."
        ),
    ] = None,
    site: Annotated[
        str | None,
        typer.Option(
            help="Site file, or name of a shipped site; required by the hardware station."
        ),
    ] = None,
    go: Annotated[
        bool, typer.Option("--go", help="Move the robot; each plan is confirmed by its hash.")
    ] = False,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the run (default: out/flatten-GARMENT-SEED).")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Resume a run from its last complete action."),
    ] = None,
    live: Annotated[
        bool | None,
        typer.Option(
            "--live/--no-live",
            help="Show the run in the browser (default: if there is a terminal).",
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(help="Port of the live view (default: the first free one from 7000)."),
    ] = None,
) -> None:
    """Look, plan, verify, pull, and look again until the garment is flat.

    Write a report of the run.
    """
    from rich.console import Console

    from unwrinkle.closed_loop.session import Choices, begin_run, resume_run

    console = Console()
    choices = Choices(
        garment=garment,
        start=start,
        texture=texture,
        seed=seed,
        sensor=sensor,
        scale=scale,
        arms=arms,
        mode=mode,
        actions=actions,
        station=station,
        order=order,
    )
    where, approve = _devices(site, go, console)
    if resume is not None:
        if scenario is not None or settings or out is not None:
            raise InputError(
                "--resume uses the scenario and the folder of the run; leave --scenario, --set and "
                "--out out"
            )
        with console.status("reading the run"):
            session = resume_run(resume, choices, site=where, approve=approve)
    else:
        with console.status("preparing the cell and the garment"):
            session = begin_run(
                choices, scenario, out, settings=settings or (), site=where, approve=approve
            )
    if approve is not None:
        approve.preview = session.folder.path / "preview.html", session.loop.station.cell
    console.print(f"run {session.folder.path}", highlight=False, soft_wrap=True)
    live = (sys.stdout.isatty() if live is None else live) or port is not None
    ending = _run(session, console, live=live, port=port)
    _print_ending(console, session, ending)
    raise typer.Exit(EXIT_CODES[ending.status])


def _devices(
    site: str | None, go: bool, console: "Console"
) -> tuple["Site | None", "Confirmation | None"]:
    """Return the site, and the confirmation of each plan."""
    from unwrinkle.execution.confirmation import Confirmation
    from unwrinkle.site.sites import find_site

    return None if site is None else find_site(site), Confirmation(console) if go else None


def _run(session: "Session", console: "Console", *, live: bool, port: int | None) -> "RunEnding":
    from unwrinkle.closed_loop.progress import ProgressWatcher
    from unwrinkle.closed_loop.watcher import LiveWatcher

    watchers: list[LiveWatcher] = []
    if live:
        from unwrinkle.viewer.scene import start_meshcat

        meshcat = start_meshcat(port=port)
        console.print(f"live at {meshcat.web_url()}", highlight=False, soft_wrap=True)
        watchers.append(LiveWatcher(session.loop, meshcat))
    with console.status("looking") as status:
        progress = ProgressWatcher(
            lambda line: console.print(line, highlight=False, markup=False, soft_wrap=True),
            status.update,
        )
        return session.run((progress, *watchers), lambda: any(w.closed for w in watchers))


def _print_ending(console: "Console", session: "Session", ending: "RunEnding") -> None:
    figures = session.folder.figures
    reason = ending.reason.removeprefix(f"{ending.status}: ")
    console.print(f"{ending.status}: {reason}", highlight=False, markup=False, soft_wrap=True)
    truth = [
        f"{name} {text}"
        for name, key, text in (
            ("coverage", "coverage", f"{figures.get('coverage', 0.0):.1%}"),
            ("largest height", "height", f"{1e3 * figures.get('height', 0.0):.1f} mm"),
        )
        if key in figures
    ]
    console.print(
        f"{figures.get('actions', 0)} actions, {ending.duration:.0f} s"
        f"{'; true values: ' if truth else ''}{', '.join(truth)}",
        highlight=False,
    )
    for name in ("report.html", "replay.html"):
        if (session.folder.path / name).is_file():
            console.print(f"{session.folder.path / name}", highlight=False, soft_wrap=True)
