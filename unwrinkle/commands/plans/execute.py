"""``unwrinkle execute``: run a verified plan on the robot or a virtual controller.

Without --go it is a dry run.
"""

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "unwrinkle execute out/first/plan.npz --site loopback",
    "unwrinkle execute out/first/plan.npz --site lab.site.yaml --go --speed 0.1 --log run.jsonl",
)


def execute(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    site: Annotated[
        str, typer.Option(help="Site file *.site.yaml, or name of a shipped site: loopback.")
    ],
    go: Annotated[
        bool,
        typer.Option("--go", help="Move the robot after confirmation; nothing moves without it."),
    ] = False,
    yes: Annotated[
        str | None,
        typer.Option(
            metavar="HASH", help="Confirm in scripts: 6 or more characters of the plan's hash."
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Share of the planned speed, above 0 and up to 1 (default: the site's)."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="Write the run log to this file (default: a new file, with --go)."),
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Write the preview page to this file before anything moves.")
    ] = None,
    live: Annotated[
        bool,
        typer.Option("--live/--no-live", help="Show the robot live; closing the page holds it."),
    ] = False,
    clear_queue: Annotated[
        bool,
        typer.Option(
            "--clear-queue",
            help="First empty the controller's queues of a broken connection, after confirmation.",
        ),
    ] = False,
    commands: Annotated[
        str | None,
        typer.Option(
            help="Read hold, resume, stop, speed, alive from a file or pipe; - for standard input."
        ),
    ] = None,
) -> None:
    """Check the robot and the plan, show the plan and, with --go, run it.

    The exit code is 4 if a check or a device fails.
    """
    from unwrinkle.execution.session import ExecutionOptions, ExecutionSession
    from unwrinkle.site.preflight_checks import check_speed

    if speed is not None:
        check_speed(speed, 1.0)
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
