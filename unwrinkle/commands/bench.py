"""``unwrinkle bench``: run one benchmark of a checkout, print its table, save its results."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer

from unwrinkle.models.errors import InputError

EXAMPLES = (
    "unwrinkle bench plans --quick",
    "unwrinkle bench stereo --seed 1 --json stereo.json --markdown stereo.md",
)


def bench(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the benchmark, e.g. plans.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Run a smaller sample, in minutes.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    from_json: Annotated[
        Path | None,
        typer.Option(help="Run nothing; take the report of an earlier run from this file."),
    ] = None,
    json: Annotated[Path | None, typer.Option(help="Write the whole report to this file.")] = None,
    markdown: Annotated[
        Path | None, typer.Option(help="Write the page to this file, and its figure beside it.")
    ] = None,
) -> None:
    """Run a benchmark of a checkout, and print its table.

    The benchmarks are no part of the installed package: run the command in a checkout of the
    sources, or from an editable install of one. `python -m benchmarks NAME` does the same there.
    """
    _command().run_benchmark(
        name, quick=quick, seed=seed, kept=from_json, json=json, markdown=markdown
    )


def _command() -> ModuleType:
    """Import the benchmarks' command from the checkout.

    Raises:
        InputError: there is no checkout, or its benchmarks lack a library.
    """
    root = checkout()
    if root is None:
        raise InputError(
            "the benchmarks are no part of the installed package; "
            "run the command in a checkout of the sources"
        )
    if str(root) not in sys.path:
        sys.path.append(str(root))
    try:
        return importlib.import_module("benchmarks.harness.command")
    except ModuleNotFoundError as error:
        raise InputError(
            f"the benchmarks need {error.name}; install their libraries: pip install -e '.[bench]'"
        ) from error


def checkout() -> Path | None:
    """Return the checkout that this package is run from, or the one in the current folder."""
    for root in (Path(__file__).resolve().parents[2], Path.cwd()):
        if (root / "benchmarks" / "harness" / "command.py").is_file():
            return root
    return None
