"""``unwrinkle preview``: show a plan in the browser, as a page or live."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.models.errors import InputError, NoVerifiedPlanError

EXAMPLES = (
    "unwrinkle preview out/first/plan.npz --html preview.html",
    "unwrinkle preview out/first/plan.npz --html preview.html --at 1.5",
)


def preview(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    html: Annotated[
        Path | None, typer.Option(help="Write a self-contained page to this file.")
    ] = None,
    live: Annotated[
        bool | None,
        typer.Option(
            "--live/--no-live", help="Show the plan live (default unless --html is given)."
        ),
    ] = None,
    at: Annotated[float | None, typer.Option(help="Open the page paused at this time, s.")] = None,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    host: Annotated[str, typer.Option(help="Address of the live server; * for all.")] = "localhost",
) -> None:
    """Verify a plan and show it with its hash and verdict; exit code 3 if it is not verified."""
    from rich.console import Console

    from unwrinkle.models.io.files import write_text
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.planning.plan import FlatteningPlan
    from unwrinkle.planning.verification.verifier import verify
    from unwrinkle.viewer.overlay import PreviewSummary
    from unwrinkle.viewer.preview import LivePreview, preview_page
    from unwrinkle.viewer.scene import start_meshcat

    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    loaded = FlatteningPlan.load(plan)
    loaded.check_made_for(cell)
    if at is not None and not 0.0 <= at <= loaded.segments[-1].end:
        raise InputError(f"--at {at:g}: the plan lasts from 0 to {loaded.segments[-1].end:.2f} s")
    live = html is None if live is None else live
    if html is None and not live:
        raise InputError("nothing to show: give --html FILE, or leave --no-live out")
    verdict = verify(loaded, cell)
    summary = PreviewSummary.of(verdict)
    console = Console()
    if html is not None:
        write_text(html, preview_page(loaded, cell, summary, title=plan.name, at=at))
        console.print(f"{html}: plan {loaded.content_hash}", highlight=False, soft_wrap=True)
    if live:
        player = LivePreview(loaded, cell, summary, meshcat := start_meshcat(host))
        console.print(f"{meshcat.web_url()}: Ctrl-C ends it", highlight=False, soft_wrap=True)
        player.run()
    if not verdict.passed:
        raise NoVerifiedPlanError(verdict.summary())
    console.print(verdict.summary(), highlight=False, soft_wrap=True)
