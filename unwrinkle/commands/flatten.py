"""``unwrinkle flatten``: the closed loop, from a crumpled garment to a flat one."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.commands._shared.capture import ScenarioOption
from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from unwrinkle.closed_loop.run import Ending
    from unwrinkle.closed_loop.session import Session
    from unwrinkle.execution.confirmation import Confirmation
    from unwrinkle.models.site import Site

#: Exit codes beside 0 (flat) and 2 (bad input): an honest stop, a fault, an interrupt.
EXIT_CODES = {"flat": 0, "stopped": 3, "fault": 1, "interrupted": 130}


def flatten(
    garment: Annotated[
        str | None, typer.Option(help="towel, dishcloth, tshirt or trousers [the scenario's].")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(help="bunched, ridge, pinched, dropped or flat [the scenario's]."),
    ] = None,
    texture: Annotated[
        str | None, typer.Option(help="terry, print or plain [the scenario's].")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of every random choice [0].")] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="stereo, xtion, tof, or truth (the simulated cloth itself) [the scenario's]."
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Of the head's pictures: 1 (16 megapixels), 0.5, 0.25 or 0.125."),
    ] = None,
    arms: Annotated[
        str | None, typer.Option(help="any (two if possible), dual or single [the scenario's].")
    ] = None,
    mode: Annotated[
        str | None,
        typer.Option(help="Pull distance: foot (all slack), paper or between [the scenario's]."),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            help="Which wrinkle first: volume, pull, height, length or together [the scenario's]."
        ),
    ] = None,
    actions: Annotated[
        int | None, typer.Option(min=0, help="Most actions [the scenario's].")
    ] = None,
    station: Annotated[
        str | None,
        typer.Option(
            help="sim, loopback (the real drivers against virtual devices) or hardware [the scenario's]."
        ),
    ] = None,
    site: Annotated[
        str | None,
        typer.Option(
            help="The site's file, or a shipped one's name; the hardware station needs it."
        ),
    ] = None,
    go: Annotated[
        bool, typer.Option("--go", help="Move the robot; each plan is confirmed by its hash.")
    ] = False,
    scenario: ScenarioOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the run [out/flatten-GARMENT-SEED].")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Go on with a run, from its last complete action."),
    ] = None,
    live: Annotated[
        bool | None,
        typer.Option("--live/--no-live", help="Show it in the browser [if a terminal is there]."),
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="Of the live view [the first free one from 7000].")
    ] = None,
) -> None:
    """Look, plan, verify, pull, and look again, until the garment is flat; watch it, and read its report."""
    from rich.console import Console

    from unwrinkle.closed_loop.session import Choices, begin, go_on

    console = Console()
    choices = Choices(
        garment, start, texture, seed, sensor, scale, arms, mode, actions, station, order
    )
    where, approve = _devices(site, go, console)
    if resume is not None:
        if scenario is not None or out is not None:
            raise InputError("--resume goes on with a run's own scenario, in its own folder")
        with console.status("reading the run"):
            session = go_on(resume, choices, site=where, approve=approve)
    else:
        with console.status("preparing the cell and the garment"):
            session = begin(choices, scenario, out, site=where, approve=approve)
    if approve is not None:
        approve.preview = session.folder.path / "preview.html", session.loop.cell
    console.print(f"run {session.folder.path}", highlight=False, soft_wrap=True)
    live = (sys.stdout.isatty() if live is None else live) or port is not None
    ending = _run(session, console, live=live, port=port)
    _say_ending(console, session, ending)
    raise typer.Exit(EXIT_CODES[ending.status])


def _devices(
    site: str | None, go: bool, console: "Console"
) -> tuple["Site | None", "Confirmation | None"]:
    """The site, and who is asked about each plan."""
    from unwrinkle.execution.confirmation import Confirmation
    from unwrinkle.site.sites import find_site

    return None if site is None else find_site(site), Confirmation(console) if go else None


def _run(session: "Session", console: "Console", *, live: bool, port: int | None) -> "Ending":
    from unwrinkle.closed_loop.progress import Progress
    from unwrinkle.closed_loop.watcher import LiveWatcher

    watchers: list[LiveWatcher] = []
    if live:
        from unwrinkle.viewer.scene import start_meshcat

        meshcat = start_meshcat(port=port)
        console.print(f"live at {meshcat.web_url()}", highlight=False, soft_wrap=True)
        watchers.append(LiveWatcher(session.loop, meshcat))
    with console.status("looking") as status:
        progress = Progress(
            lambda line: console.print(line, highlight=False, markup=False, soft_wrap=True),
            status.update,
        )
        return session.run((progress, *watchers), lambda: any(w.closed for w in watchers))


def _say_ending(console: "Console", session: "Session", ending: "Ending") -> None:
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
        f"{'; in truth: ' if truth else ''}{', '.join(truth)}",
        highlight=False,
    )
    for name in ("report.html", "replay.html"):
        if (session.folder.path / name).is_file():
            console.print(f"{session.folder.path / name}", highlight=False, soft_wrap=True)
