"""The results of the benchmark `sensitivity`."""

from dataclasses import dataclass
from typing import Any

from benchmarks.harness.statistics import Spread
from benchmarks.published.figures import RunFigures
from benchmarks.published.loop_trials import LoopTrial


@dataclass(frozen=True, kw_only=True)
class MoreFigures(RunFigures):
    """Figures of the runs of a condition.

    Attributes:
        coverage_interval: 95 % of the mean at the end.
        single: actions with one arm.
    """

    coverage_interval: tuple[float, float]
    single: int


@dataclass(frozen=True, kw_only=True)
class ConditionFigures(MoreFigures):
    """A condition and its figures.

    Attributes:
        setting, value, look, loop, sensor, material: as of `Condition`.
        to_default: actions more than the default's on the same starts; None for the default.
    """

    setting: str
    value: str
    look: str
    loop: dict[str, Any]
    sensor: dict[str, Any]
    material: dict[str, float]
    to_default: Spread | None


@dataclass(frozen=True)
class SensitivityResult:
    """The loop with one setting changed at a time.

    Attributes:
        trials_wall: time of all runs, s.
        most_actions: of a run.
        expected_core_minutes: of the whole benchmark; None for a quick run.
        conditions: with their figures.
        runs: condition by condition.
    """

    trials_wall: float
    most_actions: int
    expected_core_minutes: float | None
    conditions: tuple[ConditionFigures, ...]
    runs: tuple[LoopTrial, ...]
