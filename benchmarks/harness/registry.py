"""The benchmarks by name."""

import importlib
import typing
from typing import Any, Protocol, cast

from benchmarks.harness.report import Progress
from unwrinkle.models.errors import InputError

#: The module of each benchmark; `Benchmark` says what it offers.
MODULES = {
    "analysis": "benchmarks.perception.analysis",
    "calibration": "benchmarks.perception.calibration",
    "captures": "benchmarks.perception.captures",
    "cloth": "benchmarks.cloth.benchmark",
    "ctu_masks": "benchmarks.perception.ctu_masks",
    "depth_cameras": "benchmarks.perception.depth_cameras.benchmark",
    "faults": "tests.robustness.page",
    "folds": "benchmarks.perception.folds.benchmark",
    "garments": "benchmarks.published.garments.benchmark",
    "gaze": "benchmarks.perception.gaze.benchmark",
    "grasps": "benchmarks.published.grasps.benchmark",
    "loop": "benchmarks.loop.benchmark",
    "parity": "benchmarks.parity.benchmark",
    "plans": "benchmarks.planning.plans.benchmark",
    "sensitivity": "benchmarks.published.sensitivity.benchmark",
    "soak": "tests.robustness.soak",
    "stereo": "benchmarks.perception.stereo.benchmark",
    "table1": "benchmarks.published.table1",
    "table2": "benchmarks.published.table2",
    "trajectories": "benchmarks.planning.trajectories.benchmark",
    "wrinkledness": "benchmarks.perception.wrinkledness",
}


class Benchmark(Protocol):
    """What a benchmark's module offers; `plot(results, path)` besides, where it draws a figure."""

    def run(self, *, quick: bool, seed: int, progress: Progress) -> Any:
        """Measure, and return the results, a frozen dataclass: SI units, no NaN."""

    def table(self, results: Any) -> str:
        """Return the results as Markdown."""


def find(name: str) -> Benchmark:
    """Import the benchmark of a name.

    Raises:
        InputError: there is none.
    """
    if name not in MODULES:
        raise InputError(f"there is no benchmark {name!r}; known are {', '.join(sorted(MODULES))}")
    return cast("Benchmark", importlib.import_module(MODULES[name]))


def results_type(benchmark: Benchmark) -> Any:
    """Return the type of the results of a benchmark."""
    return typing.get_type_hints(benchmark.run)["return"]
