"""``unwrinkle show``: the robot and its cell in the browser, with a slider for each joint."""

from pathlib import Path
from typing import Annotated

import typer


def show(
    scenario: Annotated[
        Path | None, typer.Option(help="The cell; the shipped one if left out.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Write a page that stands still here, and end.")
    ] = None,
    state: Annotated[str, typer.Option(help="Named state that it starts in.")] = "home",
    host: Annotated[str, typer.Option(help="Address to serve on; * for all.")] = "localhost",
) -> None:
    """Show the cell, as it looks and as the collision checks see it."""
    from rich.console import Console

    from unwrinkle.models.io.files import write_text
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.viewer.cell_view import CellView
    from unwrinkle.viewer.scene import start_meshcat

    cell = load_cell(load_scenario(scenario))
    view = CellView(cell, meshcat := start_meshcat(host), state=state)
    console = Console()
    if html is not None:
        write_text(html, view.page())
        console.print(f"written to {html}", highlight=False, soft_wrap=True)
        return
    view.add_controls()
    console.print(f"{meshcat.web_url()}: Ctrl-C ends it", highlight=False, soft_wrap=True)
    view.run()
