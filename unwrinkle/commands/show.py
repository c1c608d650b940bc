"""``unwrinkle show``: show the robot and its cell in the browser, with a slider for each joint."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.settings import ScenarioOption, SetOption

EXAMPLES = (
    "unwrinkle show",
    "unwrinkle show --html cell.html --state ext_plus_90",
)


def show(
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    html: Annotated[
        Path | None, typer.Option(help="Write a static page to this file and exit.")
    ] = None,
    state: Annotated[str, typer.Option(help="Named state to start in.")] = "home",
    host: Annotated[str, typer.Option(help="Address of the live server; * for all.")] = "localhost",
) -> None:
    """Show the cell: its bodies and the shapes of the collision checks."""
    from rich.console import Console

    from unwrinkle.models.io.files import write_text
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.viewer.cell_view import CellView
    from unwrinkle.viewer.scene import start_meshcat

    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    view = CellView(cell, meshcat := start_meshcat(host), state=state)
    console = Console()
    if html is not None:
        write_text(html, view.page())
        console.print(f"written to {html}", highlight=False, soft_wrap=True)
        return
    view.add_controls()
    console.print(f"{meshcat.web_url()}: Ctrl-C ends it", highlight=False, soft_wrap=True)
    view.run()
