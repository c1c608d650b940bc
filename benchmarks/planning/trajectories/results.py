"""The results of the benchmark `trajectories`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.trials import KeptTrial


@dataclass(frozen=True)
class MedianMax:
    """Median and greatest value of a sample; None for an empty one."""

    median: float | None
    max: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> "MedianMax":
        """Compute both."""
        if not len(values):
            return cls(None, None)
        return cls(float(np.median(values)), float(np.max(values)))


@dataclass(frozen=True)
class DurationRatio:
    """Median, least and greatest ratio of two durations; None without a pair."""

    median: float | None
    max: float | None
    min: float | None


@dataclass(frozen=True)
class PieceFailure:
    """A piece for which a method gave nothing, and why."""

    piece: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """One method on one path.

    Attributes:
        failures: of pieces; with any, the other values are empty.
        duration: of all pieces, s; durations: of each.
        ratio: worst of every quantity to its limit.
        violations: sample intervals times axes beyond the limit, by quantity.
        deviation: of either tool centre point from the path's nearest point, m.
        joint_deviation: the same of an axis, rad.
        computing: CPU time, s.
    """

    failures: tuple[PieceFailure, ...] = ()
    duration: float = 0.0
    durations: tuple[float, ...] = ()
    ratio: dict[str, float]
    violations: dict[str, int]
    deviation: float = 0.0
    joint_deviation: float = 0.0
    computing: float = 0.0


@dataclass(frozen=True)
class PieceOptimum:
    """Times of one piece under the full limits, s.

    Attributes:
        piece: its name.
        jerk_free: without a jerk limit.
        bound: lower bound.
        refined, refined_dense: of the programme, at its nodes and on a finer grid.
        law: ours.
        starts: of the programme, from each start.
        programmes: solved.
        computing: CPU time, s.
    """

    piece: str
    jerk_free: float
    bound: float
    refined: float
    refined_dense: float
    law: float
    starts: tuple[float, ...]
    programmes: int
    computing: float


@dataclass(frozen=True, kw_only=True)
class TimedPath:
    """One path, timed by every method.

    Attributes:
        path, group: names.
        jerk_free: least time without a jerk limit, s.
        methods: by name.
        optimum: piece by piece.
    """

    path: str
    group: str
    jerk_free: float
    methods: dict[str, Judgement]
    optimum: tuple[PieceOptimum, ...]


@dataclass(frozen=True, kw_only=True)
class TimedTrial(KeptTrial, TimedPath):
    """A path that was timed and kept."""


@dataclass(frozen=True)
class MethodFigures:
    """Figures of one method over paths.

    Attributes:
        paths: how many.
        failed, failed_pieces, reasons: of them.
        clean: paths without a violation or a deviation.
        ratio: of the duration to the jerk-free one.
        duration, deviation, joint_deviation, computing: see `Judgement`.
        violations: sums by quantity.
        worst: ratios by quantity; None without a path.
    """

    paths: int
    failed: int
    failed_pieces: int
    reasons: tuple[str, ...]
    clean: int
    ratio: MedianMax
    duration: MedianMax
    deviation: MedianMax
    joint_deviation: MedianMax
    violations: dict[str, int]
    worst: dict[str, float | None]
    computing: MedianMax


@dataclass(frozen=True)
class PieceRatios:
    """Ratios of times of one piece, or of whole paths."""

    law_over_refined: MedianMax
    sent_over_refined: MedianMax
    refined_over_jerk_free: MedianMax
    refined_over_bound: MedianMax
    dense_over_refined: MedianMax


@dataclass(frozen=True)
class OptimumFigures:
    """How near ours is to the optimum.

    Attributes:
        pieces: by name.
        programmes: pieces that were solved.
        second_starts: of them, from two starts.
        starts_apart: relative difference of both.
        computing: CPU time of a piece and start, s.
    """

    pieces: dict[str, PieceRatios]
    programmes: int
    second_starts: int
    starts_apart: MedianMax
    computing: MedianMax


@dataclass(frozen=True)
class StartFigures:
    """What the start from toppra's profile does to `optimal`.

    Attributes:
        paths: with both.
        duration_ratio: with over without.
        computing, computing_without: CPU times, s.
    """

    paths: int
    duration_ratio: DurationRatio
    computing: MedianMax
    computing_without: MedianMax


@dataclass(frozen=True)
class Headline:
    """The figures that count.

    Attributes:
        ours_ratio_median, ours_ratio_max: time over the jerk-free one.
        ours_clean_paths: without a violation or a deviation.
        ours_deviation_max: m.
        ours_over_programme, ours_sent_over_programme: of whole paths.
        clean_on_every_path: methods.
        target_ratio: of the time.
        target_met_by: methods.
    """

    ours_ratio_median: float | None
    ours_ratio_max: float | None
    ours_clean_paths: int
    ours_deviation_max: float | None
    ours_over_programme: MedianMax
    ours_sent_over_programme: MedianMax
    clean_on_every_path: tuple[str, ...]
    target_ratio: float
    target_met_by: tuple[str, ...]


@dataclass(frozen=True)
class PathSetFigures:
    """The set of paths: file, hash, seed of its maker, paths, paths timed, points."""

    file: str
    sha256: str
    seed: int
    paths: int
    timed: int
    points: int


@dataclass(frozen=True)
class JudgeSettings:
    """How the methods are judged.

    Attributes:
        margin: below every limit.
        period, tracking_period: of the samples, s.
        tolerance: relative, of a limit.
        no_deviation: m, that counts as none.
    """

    margin: float
    period: float
    tracking_period: float
    tolerance: float
    no_deviation: float


@dataclass(frozen=True)
class TrajectoriesResult:
    """Ways to time the paths of the set.

    Attributes:
        set: the paths.
        judge: of all methods.
        headline: what counts.
        methods: by name.
        groups: by group of paths and name.
        optimum: what ours is compared with.
        start: of `optimal`.
        paths: every path.
    """

    set: PathSetFigures
    judge: JudgeSettings
    headline: Headline
    methods: dict[str, MethodFigures]
    groups: dict[str, dict[str, MethodFigures]]
    optimum: OptimumFigures
    start: StartFigures
    paths: tuple[TimedPath, ...]
