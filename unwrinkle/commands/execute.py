"""``unwrinkle execute``: a verified plan on the robot, or on a virtual controller; a dry run unless told to go."""

from pathlib import Path
from typing import Annotated

import typer


def execute(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    site: Annotated[str, typer.Option(help="A *.site.yaml, or a shipped site: loopback.")],
    go: Annotated[
        bool, typer.Option("--go", help="Move the robot, once confirmed; without it nothing moves.")
    ] = False,
    yes: Annotated[
        str | None,
        typer.Option(metavar="HASH", help="Confirm for scripts: 6 or more characters of the hash."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Share of the planned speed [the site's].")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Write the run log here [a new file, with --go].")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Write the preview page here before anything moves.")
    ] = None,
    live: Annotated[
        bool, typer.Option("--live/--no-live", help="Show the robot live; a closed page holds it.")
    ] = False,
    clear_queue: Annotated[
        bool,
        typer.Option(
            "--clear-queue",
            help="First empty the queues that a dead connection left in the controller, once confirmed.",
        ),
    ] = False,
    commands: Annotated[
        str | None,
        typer.Option(
            help="Take hold, resume, stop, speed, alive from a file or pipe, - for stdin."
        ),
    ] = None,
) -> None:
    """Check everything, show the plan and, with --go, run it; exit code 4 where a device or check stands against it."""
    from unwrinkle.execution.session import ExecutionOptions, ExecutionSession

    options = ExecutionOptions(
        plan=plan,
        site=site,
        go=go,
        confirmation=yes,
        speed=speed,
        log=log,
        html=html,
        live=live,
        commands=commands,
        clear_queue=clear_queue,
    )
    number = ExecutionSession(options).run()
    if number:  # a signal ended it
        raise typer.Exit(128 + number)
