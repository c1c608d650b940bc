"""Options that choose a scenario or a site and change single settings of it.

A value comes from the schema's default, the file, `--set`, or an option such as `--mode`; the later
in this order wins.
"""

from pathlib import Path
from typing import Annotated

import typer

ScenarioOption = Annotated[
    Path | None, typer.Option(help="Scenario file *.scenario.yaml; the shipped one if left out.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Setting of the scenario to change, e.g. loop.mode=paper; repeatable. It wins over "
        "the file, and options such as --mode win over it.",
    ),
]
SiteSetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Setting of the site to change, e.g. controller.lead=0.1; repeatable. It wins over "
        "the file.",
    ),
]
