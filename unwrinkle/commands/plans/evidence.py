"""``unwrinkle evidence``: document a plan at a site for a risk assessment."""

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "unwrinkle evidence out/first/plan.npz --site loopback",
    "unwrinkle evidence out/first/plan.npz --site lab.site.yaml --out evidence/first",
)


def evidence(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    site: Annotated[
        str, typer.Option(help="Site file *.site.yaml, or name of a shipped site: loopback.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the document (default: beside the plan)."),
    ] = None,
) -> None:
    """Write evidence.html and evidence.json: what a risk assessment can cite about a plan.

    Swept space, speeds and energies of the bodies, holds by the site's settings, clearances,
    assumptions, hashes and versions. No safety function: no PL and no SIL is claimed. Exit code 3
    if the plan is not verified.
    """
    from rich.console import Console

    from unwrinkle.evidence.document import write_evidence
    from unwrinkle.evidence.pack import collect_evidence

    console = Console()
    with console.status("verifying and sampling the plan"):
        found = collect_evidence(plan, site)
        page, record = write_evidence(found, plan.parent if out is None else out)
    console.print(found.verdict.summary(), highlight=False, soft_wrap=True)
    for name, passed, text in found.site_checks:
        if not passed:
            console.print(f"[bold]note[/bold]: {name}: {text}", highlight=False, soft_wrap=True)
    console.print(f"page    {page}", highlight=False, soft_wrap=True)
    console.print(f"record  {record}", highlight=False, soft_wrap=True)
