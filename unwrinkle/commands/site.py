"""``unwrinkle site``: is every device of a site there and well? Moves nothing."""

from typing import Annotated

import typer

site = typer.Typer(help="Look at a site's devices; moves nothing.", no_args_is_help=True)

#: Columns of a table that is not shown in a terminal.
_WIDTH = 140


@site.callback()
def _site() -> None:
    """Look at a site's devices; moves nothing."""


@site.command()
def check(
    name: Annotated[
        str, typer.Argument(metavar="SITE", help="A *.site.yaml, or a shipped site: loopback.")
    ],
    clear_queue: Annotated[
        bool,
        typer.Option(
            "--clear-queue",
            help="First empty the queues that a dead connection left in the controller, once confirmed.",
        ),
    ] = False,
) -> None:
    """Ask every device and say what is missing and what to do; exit code 4 if something is."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from unwrinkle.models.errors import HardwareError
    from unwrinkle.site.check import check_site
    from unwrinkle.site.queue_clearing import clear_confirmed
    from unwrinkle.site.sites import find_site, site_cell

    found = find_site(name)
    limits = site_cell(found).limits
    console = Console()
    if clear_queue:
        clear_confirmed(found, console)
    with console.status("") as status:
        rows = check_site(found, limits, tell=lambda text: status.update(f"asking {text}"))
    if not console.is_terminal:
        console.width = _WIDTH
    table = Table(title=f"Site {found.name}", title_justify="left", box=box.SIMPLE)
    for column in ("device", "result", "what was found"):
        table.add_column(column, no_wrap=column != "what was found")
    for row in rows:
        table.add_row(row.name, "ok" if row.passed else "[bold red]MISSING[/bold red]", row.text)
    console.print(table)
    bad = [row.name for row in rows if not row.passed]
    if bad:
        raise HardwareError(f"site {found.name}: {len(bad)} of {len(rows)} rows: {', '.join(bad)}")
    console.print(f"site {found.name}: every device answers", highlight=False)
