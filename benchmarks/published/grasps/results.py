"""The results of the benchmark `grasps`."""

from dataclasses import dataclass
from typing import Any

from benchmarks.harness.trials import KeptTrial


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A pinch and a lift at one point; what was not come to is None.

    Attributes:
        success: the garment was lifted.
        cause, reason: of a failure.
        arm, turntable, tilt, offset: of the plan, see `PinchPlan`.
        tips: world x, y of the ends of either blade's tip, m.
        withheld, layers, pressed, depth, nodes: of what was caught, see `Catch`.
        misplaced: share of eight directions in which the blades still catch cloth, for each
            misplacement.
        area, weight: of what was lifted, m^2, N.
        inset: of the point from the garment's rim, m.
        proposal: that the point is of.
    """

    success: bool
    cause: str | None = None
    reason: str | None = None
    arm: int | None = None
    turntable: float | None = None
    tilt: float | None = None
    offset: float | None = None
    tips: list[list[list[float]]] | None = None
    withheld: float | None = None
    layers: int | None = None
    pressed: float | None = None
    depth: float | None = None
    nodes: int | None = None
    misplaced: tuple[float, ...] | None = None
    area: float | None = None
    weight: float | None = None
    inset: float | None = None
    proposal: dict[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class GraspRun:
    """One state from one seed, pinched at every point.

    Attributes:
        wrinkles: found.
        coverage, height: by truth; height in m.
        choices: by point.
    """

    wrinkles: int
    coverage: float
    height: float
    choices: dict[str, Attempt]


@dataclass(frozen=True, kw_only=True)
class GraspTrial(KeptTrial, GraspRun):
    """A run that was kept."""


@dataclass(frozen=True)
class ChoiceFigures:
    """Figures of one point over runs.

    Attributes:
        successes, attempts, interval: with the share's 95 % interval.
        planned: attempts that had a plan.
        causes: of failures, how many.
        depth, inset: medians, m.
        misplaced: means of the shares.
        weight_most: N.
    """

    successes: int
    attempts: int
    interval: tuple[float, float]
    planned: int
    causes: dict[str, int]
    depth: float | None
    misplaced: tuple[float, ...] | None
    inset: float | None
    weight_most: float | None


@dataclass(frozen=True)
class StateFigures:
    """Figures of one state.

    Attributes:
        title: of it.
        wrinkles, layers: means.
        height: median of the highest points, m.
        choices: by point.
    """

    title: str
    wrinkles: float
    layers: float
    height: float
    choices: dict[str, ChoiceFigures]


@dataclass(frozen=True)
class LeftOut:
    """A start that could not be made, and why."""

    start: str
    reason: str


@dataclass(frozen=True)
class PublishedGrasps:
    """The published successes."""

    successes: int
    attempts: int


@dataclass(frozen=True)
class GraspsResult:
    """Five states, pinched at several points.

    Attributes:
        starts_left_out: those that could not be made.
        trials_wall: time of all runs, s.
        successes, attempts, success, success_interval: at the wrinkledness point.
        published: of a real robot.
        misplaced: distances, m.
        overall: by point.
        states: by name.
        runs: all.
    """

    starts_left_out: tuple[LeftOut, ...]
    trials_wall: float
    successes: int
    attempts: int
    success: float
    success_interval: tuple[float, float]
    published: PublishedGrasps
    misplaced: tuple[float, ...]
    overall: dict[str, ChoiceFigures]
    states: dict[str, StateFigures]
    runs: tuple[GraspTrial, ...]
