"""``unwrinkle log``: show a run log of `unwrinkle execute`, also one that a crash cut short."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.examples import examples
from unwrinkle.commands._shared.settings import SetOption

log = typer.Typer(help="Show or replay the log of an execution.", no_args_is_help=True)

_LogArgument = Annotated[Path, typer.Argument(metavar="LOG", help="Log of `unwrinkle execute`.")]
_ScenarioOption = Annotated[
    Path | None, typer.Option(help="Scenario of the cell; the log's own if left out.")
]
#: Width of a table outside a terminal, columns.
_WIDTH = 140


@log.command(epilog=examples("unwrinkle log show run.jsonl", "unwrinkle -v log show out/run.jsonl"))
def show(path: _LogArgument) -> None:
    """Print the header, counts, states and events of a log."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from unwrinkle.hardware.run_log.reader import read_run_log
    from unwrinkle.logs.summary import event_rows, summary_rows

    records = read_run_log(path)
    console = Console()
    if not console.is_terminal:
        console.width = _WIDTH
    facts = Table(title=str(path), title_justify="left", box=box.SIMPLE, show_header=False)
    for name, value in summary_rows(records):
        facts.add_row(name, value)
    console.print(facts)
    happened = Table("time", "what", "text", title="Events", title_justify="left", box=box.SIMPLE)
    for row in event_rows(records):
        happened.add_row(*row)
    console.print(happened)


@log.command(
    epilog=examples(
        "unwrinkle log replay run.jsonl",
        "unwrinkle log replay run.jsonl --html run.html --scenario lab.scenario.yaml",
    )
)
def replay(
    path: _LogArgument,
    html: Annotated[
        Path | None, typer.Option(help="Write the page to this file (default: beside the log).")
    ] = None,
    scenario: _ScenarioOption = None,
    settings: SetOption = None,
) -> None:
    """Write a page with the robot's measured motion."""
    from rich.console import Console

    from unwrinkle.hardware.run_log.reader import read_run_log
    from unwrinkle.logs.replay import cell_of, plan_of, replay_page
    from unwrinkle.models.io.files import write_text

    records = read_run_log(path)
    page = path.with_suffix(".html") if html is None else html
    cell = cell_of(records, scenario, settings or ())
    write_text(page, replay_page(records, cell, plan_of(records), title=path.name))
    Console().print(f"replay  {page}", highlight=False, soft_wrap=True)
