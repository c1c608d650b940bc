"""``unwrinkle bench``: run one benchmark, print its table, save its results."""

import importlib
import pkgutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    from unwrinkle.benchmarks.report import Benchmark

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
    json: Annotated[Path | None, typer.Option(help="Write the whole report to this file.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table to this file.")] = None,
) -> None:
    """Run a benchmark and print its table."""
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn

    from unwrinkle.benchmarks import report as reports
    from unwrinkle.models.io.files import write_json, write_text

    benchmark = _find(name)
    with Progress(
        *Progress.get_default_columns(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bars:
        task = bars.add_task(name, total=None)

        def progress(done: int, total: int, stage: str) -> None:
            bars.update(task, description=stage, completed=done, total=total)

        start = time.perf_counter()
        results = benchmark.run(quick=quick, seed=seed, progress=progress)
        duration = time.perf_counter() - start

    report = reports.report(name, results, quick=quick, seed=seed, duration=duration)
    page = reports.markdown(report, benchmark.table(results))
    sys.stdout.write(page)
    if json is not None:
        write_json(json, report)
    if markdown is not None:
        write_text(markdown, page)
        plot = getattr(benchmark, "plot", None)  # some benchmarks draw a figure beside their table
        if plot is not None:
            plot(results, markdown.with_suffix(".png"))


def benchmark_names() -> list[str]:
    """Return the names that `unwrinkle bench` accepts.

    They are the public modules of `unwrinkle.benchmarks`.
    """
    from unwrinkle import benchmarks

    names = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    return sorted(name for name in names if name != "report" and not name.startswith("_"))


def _find(name: str) -> "Benchmark":
    """Import the benchmark `name`.

    Raises:
        InputError: there is no benchmark of that name.
    """
    names = benchmark_names()
    if name not in names:
        raise InputError(f"there is no benchmark {name!r}; known are {', '.join(names)}")
    return cast("Benchmark", importlib.import_module(f"unwrinkle.benchmarks.{name}"))
