"""``unwrinkle verify``: check a plan independently, on the samples that will be sent."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.posture import StartOption, posture
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.models.errors import NoVerifiedPlanError

#: Width of a table outside a terminal, columns.
_WIDTH = 120
_NUMBERS = ("worst", "limit", "margin", "nearest", "lower bound", "required")

EXAMPLES = (
    "unwrinkle verify out/first/plan.npz",
    "unwrinkle verify out/lab/plan.npz --scenario lab.scenario.yaml --json verdict.json",
)


def verify(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    start: StartOption = None,
    json: Annotated[Path | None, typer.Option(help="Write the whole verdict to this file.")] = None,
) -> None:
    """Verify a plan and print every check with its margin.

    The exit code is 3 if the plan is not verified.
    """
    from rich.console import Console

    from unwrinkle.models.io.files import write_json
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.planning.plan import FlatteningPlan
    from unwrinkle.planning.verification.verifier import verify as verify_plan

    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    loaded = FlatteningPlan.load(plan)
    loaded.check_made_for(cell)
    standing = None if start is None else posture(start, cell.robot)
    verdict = verify_plan(loaded, cell, start=standing)
    if json is not None:
        write_json(json, verdict.to_json())
    console = Console()
    if not console.is_terminal:
        console.width = _WIDTH
    checks = ("check", "result", "worst", "limit", "margin", "where")
    _print(console, "Checks", checks, verdict.rows())
    pairs = ("bodies", "kind", "nearest", "lower bound", "required", "when")
    _print(console, "Pairs nearest to their padding", pairs, verdict.clearance_rows())
    for violation in verdict.violations:
        console.print(
            f"[bold]{violation.kind.replace('_', ' ')}[/bold]: {violation.message}", highlight=False
        )
    if not verdict.passed:
        raise NoVerifiedPlanError(verdict.summary())
    console.print(verdict.summary(), highlight=False)


def _print(console, title, columns, rows) -> None:  # type: ignore[no-untyped-def]
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for column in columns:
        table.add_column(
            column, justify="right" if column in _NUMBERS else "left", no_wrap=column != "where"
        )
    for row in rows:
        table.add_row(*row)
    console.print(table)
