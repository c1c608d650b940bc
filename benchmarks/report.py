"""What every benchmark report holds beside its results: the machine, the versions, the command."""

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

_DISTRIBUTIONS = {
    "unwrinkle": "unwrinkle",
    "drake": "drake",
    "numpy": "numpy",
    "scipy": "scipy",
    "opencv": "opencv-python-headless",
    "toppra": "toppra",
    "ruckig": "ruckig",
    "ompl": "ompl",
    "numba": "numba",
}


class Progress(Protocol):
    """How a benchmark tells how far it is."""

    def __call__(self, done: int, total: int, stage: str) -> None:
        """Say that `done` of `total` parts of `stage` (a word or two) are finished."""


class Benchmark(Protocol):
    """What a benchmark module offers."""

    def run(self, *, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
        """Measure, and return the results: JSON values and NumPy arrays, SI units, no NaN."""

    def table(self, results: dict[str, Any]) -> str:
        """Return the results as Markdown."""


def machine() -> dict[str, Any]:
    """Describe this machine: cpu (model), cores (usable here), memory (bytes), system, python."""
    return {
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)),
        "memory": os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def versions() -> dict[str, str | None]:
    """Return the installed version of each library a figure may depend on; None if absent."""
    return {name: _version(distribution) for name, distribution in _DISTRIBUTIONS.items()}


def report(
    name: str, results: dict[str, Any], *, quick: bool, seed: int, duration: float
) -> dict[str, Any]:
    """Return the whole report of one run, as it is written to JSON.

    Args:
        name: the benchmark's name.
        results: what its `run` returned.
        quick: whether a smaller sample was taken.
        seed: of every random choice in the run.
        duration: of the run, in seconds.
    """
    return {
        "benchmark": name,
        "command": f"unwrinkle bench {name} --seed {seed}" + (" --quick" if quick else ""),
        "quick": quick,
        "seed": seed,
        "duration": duration,
        "machine": machine(),
        "versions": versions(),
        "results": results,
    }


def markdown(report: dict[str, Any], table: str) -> str:
    """Return a page for `docs/results/`: the command, the machine, the versions, the table.

    Args:
        report: as `report` returns it.
        table: the benchmark's own Markdown.
    """
    computer = report["machine"]
    quick = " (quick: a smaller sample)" if report["quick"] else ""
    rows = report["results"].get("rows_wall")
    kept = (
        "" if rows is None else f" (its rows {rows:.0f} s in all, those kept from before included)"
    )
    libraries = ", ".join(f"{name} {v}" for name, v in report["versions"].items() if v)
    return (
        f"# Benchmark: {report['benchmark']}{quick}\n\n"
        f"    {report['command']}\n\n"
        f"Took {report['duration']:.0f} s{kept} on {computer['cpu']}, {computer['cores']} cores, "
        f"{computer['memory'] / 2**30:.1f} GiB; {computer['system']}, "
        f"Python {computer['python']}; {libraries}.\n\n"
        f"{table.strip()}\n"
    )


def _cpu_model() -> str:
    """Return the processor's name as Linux gives it, or as much as Python knows."""
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
