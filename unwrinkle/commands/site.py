"""``unwrinkle site``: check that every device of a site answers and works; moves nothing."""

from typing import Annotated

import typer

from unwrinkle.commands._shared.examples import examples
from unwrinkle.commands._shared.settings import SiteSetOption

site = typer.Typer(help="Check a site's devices; moves nothing.", no_args_is_help=True)

#: Width of a table outside a terminal, columns.
_WIDTH = 140


@site.callback()
def _site() -> None:
    """Check a site's devices; moves nothing."""


@site.command(
    epilog=examples(
        "unwrinkle site check loopback",
        "unwrinkle site check lab.site.yaml --set controller.host=192.168.255.1",
    )
)
def check(
    name: Annotated[
        str,
        typer.Argument(
            metavar="SITE", help="Site file *.site.yaml, or name of a shipped site: loopback."
        ),
    ],
    settings: SiteSetOption = None,
    clear_queue: Annotated[
        bool,
        typer.Option(
            "--clear-queue",
            help="First empty the controller's queues of a broken connection, after confirmation.",
        ),
    ] = False,
) -> None:
    """Query every device and report what is missing and what to do.

    The exit code is 4 if a device is missing.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from unwrinkle.models.errors import HardwareError
    from unwrinkle.site.check import check_site
    from unwrinkle.site.queue_clearing import clear_confirmed
    from unwrinkle.site.sites import find_site, site_cell

    found = find_site(name, settings=settings or ())
    limits = site_cell(found).limits
    console = Console()
    if clear_queue:
        clear_confirmed(found, console)
    with console.status("") as status:
        rows = check_site(found, limits, tell=lambda text: status.update(f"checking {text}"))
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
        raise HardwareError(
            f"site {found.name}: {len(bad)} of {len(rows)} checks failed: {', '.join(bad)}"
        )
    console.print(f"site {found.name}: every device answers", highlight=False)
