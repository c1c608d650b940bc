"""What every benchmark's report holds beside its results: the machine, the versions, the command."""

import dataclasses
import json
import os
import platform
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from benchmarks.harness.results import from_json
from unwrinkle.models.errors import InputError

#: Distributions that a figure may depend on, by the names that pages use.
DISTRIBUTIONS = {
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


@dataclass(frozen=True)
class Machine:
    """A computer.

    Attributes:
        cpu: its model.
        cores: usable by this process.
        memory: bytes.
        system: operating system and architecture.
        python: version.
    """

    cpu: str
    cores: int
    memory: int
    system: str
    python: str


@dataclass(frozen=True)
class Report:
    """One run of a benchmark, as it is written to JSON.

    Attributes:
        benchmark: its name.
        command: that made it.
        quick: whether a smaller sample was taken.
        seed: of every random choice in the run.
        duration: of the run, s.
        machine: that it ran on.
        versions: of each library that a figure may depend on; None if absent.
        results: of the benchmark's own type, a frozen dataclass; `trials_wall` of it, where there
            is one, is the time of all trials, s.
    """

    benchmark: str
    command: str
    quick: bool
    seed: int
    duration: float
    machine: Machine
    versions: dict[str, str | None]
    results: Any


def make_report(name: str, results: Any, *, quick: bool, seed: int, duration: float) -> Report:
    """Return the report of a run on this machine; arguments as of `Report`."""
    command = f"unwrinkle bench {name} --seed {seed}" + (" --quick" if quick else "")
    return Report(name, command, quick, seed, duration, machine(), versions(), results)


def load_report(path: Path, kind: Any) -> Report:
    """Load a report that was written to JSON.

    Args:
        path: of the file.
        kind: type of the results.

    Raises:
        InputError: the file cannot be read, or does not hold such a report.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; name the JSON file of a report") from None
    report = from_json(Report, values, str(path))
    return dataclasses.replace(report, results=from_json(kind, report.results, str(path)))


def page(report: Report, table: str) -> str:
    """Return a page for `docs/results/`: the command, the machine, the versions, the table.

    Args:
        report: of a run.
        table: the benchmark's own Markdown.
    """
    computer = report.machine
    quick = " (quick: a smaller sample)" if report.quick else ""
    wall = getattr(report.results, "trials_wall", None)
    kept = (
        ""
        if wall is None
        else f" (its trials {wall:.0f} s in all, those kept from before included)"
    )
    libraries = ", ".join(f"{name} {v}" for name, v in report.versions.items() if v)
    return (
        f"# Benchmark: {report.benchmark}{quick}\n\n"
        f"    {report.command}\n\n"
        f"Took {report.duration:.0f} s{kept} on {computer.cpu}, {computer.cores} cores, "
        f"{computer.memory / 2**30:.1f} GiB; {computer.system}, "
        f"Python {computer.python}; {libraries}.\n\n"
        f"{table.strip()}\n"
    )


def machine() -> Machine:
    """Describe this machine."""
    return Machine(
        _cpu_model(),
        len(os.sched_getaffinity(0)),
        os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
        f"{platform.system()} {platform.machine()}",
        platform.python_version(),
    )


def versions() -> dict[str, str | None]:
    """Return the installed version of each library a figure may depend on; None if absent."""
    return {name: _version(distribution) for name, distribution in DISTRIBUTIONS.items()}


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
