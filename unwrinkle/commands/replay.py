"""``unwrinkle replay``: write the pages of a run, or show the run live."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.settings import SetOption

EXAMPLES = (
    "unwrinkle replay out/flatten-towel-0",
    "unwrinkle replay out/flatten-towel-0 --live --port 7001",
)


def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder of `unwrinkle flatten`.")],
    live: Annotated[
        bool,
        typer.Option("--live/--no-live", help="Show the run live instead of writing the pages."),
    ] = False,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the replay in the browser.")
    ] = False,
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario of the cell; the run's own if left out.")
    ] = None,
    settings: SetOption = None,
    host: Annotated[str, typer.Option(help="Address of the live server; * for all.")] = "localhost",
    port: Annotated[
        int | None, typer.Option(help="Port of the live server (default: first free).")
    ] = None,
) -> None:
    """Write a run's replay and report from its folder, or show the run live."""
    from rich.console import Console

    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.report.live import LiveReplay
    from unwrinkle.report.page import write_report
    from unwrinkle.report.replay import write_replay
    from unwrinkle.runs.folder import RunFolder
    from unwrinkle.viewer.scene import start_meshcat

    folder = RunFolder.open(run)
    file = folder.scenario_file if scenario is None else scenario
    cell = load_cell(load_scenario(file, settings=settings or ()))
    console = Console()
    if live:
        player = LiveReplay(folder, cell, meshcat := start_meshcat(host, port))
        console.print(f"{meshcat.web_url()}: Ctrl-C ends it", highlight=False, soft_wrap=True)
        player.run()
        return
    page = write_replay(folder, cell)
    console.print(f"replay  {page}", highlight=False, soft_wrap=True)
    console.print(f"report  {write_report(folder)}", highlight=False, soft_wrap=True)
    if show:
        typer.launch(page.resolve().as_uri())
