"""Run a benchmark, print its page, save its results: the body of `unwrinkle bench`."""

import sys
import time
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from benchmarks.harness.registry import Benchmark, find, results_type
from benchmarks.harness.report import Report, load_report, make_report, page
from benchmarks.harness.results import to_json
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_json, write_text


def run_benchmark(
    name: str,
    *,
    quick: bool = False,
    seed: int = 0,
    kept: Path | None = None,
    json: Path | None = None,
    markdown: Path | None = None,
) -> None:
    """Run a benchmark, or take the report of an earlier run, and print its page.

    Args:
        name: of the benchmark.
        quick: take a smaller sample.
        seed: of all random numbers.
        kept: JSON file of an earlier run; nothing is run, and no figure drawn.
        json: file for the report.
        markdown: file for the page; the figure of a run is written beside it.

    Raises:
        InputError: there is no such benchmark, `kept` is no report of it, or a file cannot be
            written.
    """
    benchmark = find(name)
    if kept is None:
        report = _measured(benchmark, name, quick=quick, seed=seed)
    else:
        report = load_report(kept, results_type(benchmark))
        if report.benchmark != name:
            raise InputError(f"{kept}: is a report of {report.benchmark}, not of {name}")
    text = page(report, benchmark.table(report.results))
    sys.stdout.write(text)
    if json is not None:
        write_json(json, to_json(report))
    if markdown is not None:
        write_text(markdown, text)
        plot = getattr(benchmark, "plot", None)  # some benchmarks draw a figure beside their table
        if plot is not None and kept is None:  # figures show trials that are not in the report
            plot(report.results, markdown.with_suffix(".png"))


def _measured(benchmark: Benchmark, name: str, *, quick: bool, seed: int) -> Report:
    """Run a benchmark with a progress bar on stderr."""
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
    return make_report(name, results, quick=quick, seed=seed, duration=duration)
