"""`unwrinkle bench gaze`: gaze and vergence in the rendered cell, from random starts.

The loop is closed through full-size photographs (4928 x 3264, distorted, blurred, noisy) and
virtual pan-tilt units that go in whole steps and come to rest a little beside them. The target is
the middle of a garment as the left eye saw it once. Truth is where that surface point projects in
each eye at the angles that the units really stand at.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from benchmarks.perception.gaze.rendered_head import HeadInCell
from benchmarks.perception.gaze.visual_search import SearchFigures, search_results
from unwrinkle.models.transforms import turn
from unwrinkle.perception.features import Template, template, view
from unwrinkle.perception.gaze.vergence import TOLERANCE, Centring, centre
from unwrinkle.perception.stereo.head import Eye, Gaze, StereoHead

KINDS = ("terry", "print", "plain")
CASES = {
    "gaze": "both eyes off, each sees a quarter of the garment or more",
    "gaze, poor calibration": "the same, the head's model off by 0.3 deg per mount axis and 1 % focal length",
    "gaze, one eye": "the right eye does not see the garment",
    "vergence": "the right eye off, the left one looks at the garment",
}
_LOOKS = 3
_PAN, _TILT = math.radians(15.0), math.radians(10.0)  # how far off the starts are at most
_LEAST_OFF = math.radians(3.0)
_LEAST_SEEN = 0.25  # of the garment
_OFF_MOUNT = math.radians(0.3)
_OFF_FOCAL = 0.01


@dataclass(frozen=True)
class GazeStart:
    """Gaze from one start; angles in rad, errors are true ones.

    Attributes:
        case, cloth, start: which.
        start_offset, offsets: of left and right eye, at first and at each look.
        looks: made.
        settled, reason: how it ended.
        error: of the worse eye; left_error, right_error, vergence_error.
        converged: within the tolerance, in few looks.
        correlation: of both eyes, at last.
        times: of each look, s.
    """

    case: str
    cloth: str
    start: int
    start_offset: tuple[float, float]
    offsets: tuple[tuple[float, float], ...]
    looks: int
    settled: bool
    reason: str
    error: float
    left_error: float
    right_error: float
    vergence_error: float
    converged: bool
    correlation: tuple[float, ...]
    times: tuple[float, ...]


@dataclass(frozen=True)
class CaseFigures:
    """One case: starts, those that converged, most looks, errors, rad."""

    case: str
    starts: int
    converged: int
    looks_max: int
    error_median: float
    error_max: float


@dataclass(frozen=True)
class GazeResult:
    """Gaze and vergence from random starts, and visual search; angles in rad, times in s."""

    starts: int
    starts_converged: int
    looks_max: int
    error_max: float
    error_median: float
    vergence_error_max: float
    time_per_look_median: float
    time_per_look_max: float
    tolerance: float
    step: float
    cases: tuple[CaseFigures, ...]
    search: SearchFigures
    trials: tuple[GazeStart, ...]


def run(*, quick: bool, seed: int, progress: Progress) -> GazeResult:
    """Measure. See the module; angles in radians, times in seconds."""
    counts = dict(zip(CASES, (3, 0, 0, 0) if quick else (10, 4, 3, 4), strict=True))
    total, done = sum(counts.values()), 0
    rng = np.random.default_rng(seed)
    rows: list[GazeStart] = []
    for index, kind in enumerate(KINDS):
        cell = HeadInCell.of(kind, seed + index)
        target, aim = _target(cell)
        for case, count in counts.items():
            for number in range(index, count, len(KINDS)):
                progress(done, total, f"{case}, {kind}")
                rows.append(_start(cell, case, kind, number, target, aim, rng))
                done += 1
    progress(total, total, "visual search")
    gaze = [row for row in rows if row.case == "gaze"]
    times = [time for row in rows for time in row.times]
    return GazeResult(
        starts=len(gaze),
        starts_converged=sum(row.converged for row in gaze),
        looks_max=max(row.looks for row in gaze),
        error_max=max(row.error for row in gaze),
        error_median=float(np.median([row.error for row in gaze])),
        vergence_error_max=max(row.vergence_error for row in gaze),
        time_per_look_median=float(np.median(times)),
        time_per_look_max=max(times),
        tolerance=TOLERANCE,
        step=cell.units[0].step,
        cases=tuple(_summary(case, [r for r in rows if r.case == case]) for case in CASES),
        search=search_results(seed, 2 if quick else 5),
        trials=tuple(rows),
    )


def _target(cell: HeadInCell) -> tuple[Template, NDArray[np.float64]]:
    """The garment as the left eye saw it once from elsewhere, and its middle in the world."""
    middle = cell.outline.mean(axis=0)
    gaze = cell.head.gaze_at(middle + [0.06, 0.08, 0.0])
    left, _, _ = cell.take(gaze)
    thing = template(view(left), "garment", mask=cell.mask(cell.true_gaze))
    return thing, cell.point_at(thing.centre + thing.origin)


def _start(
    cell: HeadInCell,
    case: str,
    kind: str,
    number: int,
    target: Template,
    aim: NDArray[np.float64],
    rng: np.random.Generator,
) -> GazeStart:
    start = _random_start(cell, case, aim, rng)
    head = _miscalibrated(cell.head, rng) if "poor" in case else cell.head
    cell.begin(aim)
    vergence = case == "vergence"
    outcome = centre(
        head,
        None if vergence else target,
        start,
        cell.take,
        height=cell.surface,
        max_measurements=5,
    )
    cell.stop_clock()
    left, right = cell.offsets[-1]
    _, verged = cell.off_axis(
        cell.point_at(np.array([cell.head.left.camera.cx, cell.head.left.camera.cy]))
    )
    error = verged if vergence else max(left, right)
    return GazeStart(
        case=case,
        cloth=kind,
        start=number,
        start_offset=(cell.offsets[0][0], cell.offsets[0][1]),
        offsets=tuple((pair[0], pair[1]) for pair in cell.offsets),
        looks=len(outcome.measurements),
        settled=outcome.centred,
        reason=outcome.reason,
        error=error,
        left_error=left,
        right_error=right,
        vergence_error=verged,
        converged=bool(
            outcome.centred and error <= TOLERANCE and len(outcome.measurements) <= _LOOKS
        ),
        correlation=_correlations(outcome),
        times=tuple(cell.times),
    )


def _correlations(outcome: Centring) -> tuple[float, ...]:
    last = outcome.measurements[-1]
    return tuple(float(getattr(sight, "correlation", 0.0)) for sight in (last.left, last.right))


def _random_start(
    cell: HeadInCell, case: str, aim: NDArray[np.float64], rng: np.random.Generator
) -> Gaze:
    good = cell.head.gaze_at(aim)
    while True:
        off = rng.uniform(-1.0, 1.0, 4) * [_PAN, _TILT, _PAN, _TILT]
        if case == "gaze, one eye":
            off[2] = -2.5 * _PAN
        if case == "vergence":
            off[:2] *= 0.3
        start = Gaze(*(np.array([*good.left, *good.right]) + off))
        left, right = cell.shares_seen(start)
        far = min(np.hypot(*off[:2]), np.hypot(*off[2:]))
        if case == "gaze, one eye" and (right > 0.0 or left < _LEAST_SEEN):
            continue
        if case != "gaze, one eye" and min(left, right) < _LEAST_SEEN:
            continue
        if case == "vergence" or far >= _LEAST_OFF:
            return start


def _miscalibrated(head: StereoHead, rng: np.random.Generator) -> StereoHead:
    def off(eye: Eye) -> Eye:
        X_MC = eye.X_MC.copy()
        for axis in "xyz":
            X_MC = X_MC @ turn(axis, float(rng.choice([-1.0, 1.0])) * _OFF_MOUNT)
        gain = 1.0 + _OFF_FOCAL * float(rng.choice([-1.0, 1.0]))
        camera = dataclasses.replace(eye.camera, fx=eye.camera.fx * gain, fy=eye.camera.fy * gain)
        return dataclasses.replace(eye, camera=camera, X_MC=X_MC)

    return dataclasses.replace(head, left=off(head.left), right=off(head.right))


def _summary(case: str, rows: Sequence[GazeStart]) -> CaseFigures:
    return CaseFigures(
        case=case,
        starts=len(rows),
        converged=sum(row.converged for row in rows),
        looks_max=max((row.looks for row in rows), default=0),
        error_median=float(np.median([row.error for row in rows])) if rows else 0.0,
        error_max=max((row.error for row in rows), default=0.0),
    )


def table(results: GazeResult) -> str:
    """Return the results as Markdown."""

    def mdeg(angle: float) -> str:
        return f"{1e3 * math.degrees(angle):.1f}"

    lines = [
        (
            f"Target: within {mdeg(results.tolerance)} mdeg in at most {_LOOKS} looks. One step "
            f"of the units is {mdeg(results.step)} mdeg. Errors are true ones, of the worse eye."
        ),
        "",
        line(
            "case", "starts", "converged", "looks, most", "error, median mdeg", "error, worst mdeg"
        ),
        rule(6),
    ]
    lines += [
        line(
            f"{c.case}: {CASES[c.case]}",
            f"{c.starts}",
            f"{c.converged}",
            f"{c.looks_max}",
            f"{mdeg(c.error_median)}",
            f"{mdeg(c.error_max)}",
        )
        for c in results.cases
        if c.starts
    ]
    lines += [
        "",
        (
            f"Computing per look, both eyes: {1e3 * results.time_per_look_median:.0f} ms median, "
            f"{1e3 * results.time_per_look_max:.0f} ms worst. Vergence error after gaze: "
            f"{mdeg(results.vergence_error_max)} mdeg at worst."
        ),
        "",
        _search_line(results.search),
        "",
        line(
            "case",
            "cloth",
            "off at the start, deg (left, right)",
            "looks",
            "left mdeg",
            "right mdeg",
        ),
        rule(6),
    ]
    for row in results.trials:
        off = ", ".join(f"{math.degrees(angle):.1f}" for angle in row.start_offset)
        ends = [mdeg(row.left_error), mdeg(row.right_error)]
        if row.case == "vergence":  # of the point that the left eye looks at
            ends = ["-", mdeg(row.vergence_error)]
        lines.append(
            line(f"{row.case}", f"{row.cloth}", f"{off}", f"{row.looks}", f"{' | '.join(ends)}")
        )
    return "\n".join(lines) + "\n"


def _search_line(search: SearchFigures) -> str:
    return (
        f"Visual search, {search.scenes} pictures of the table, each with two towels of one print, "
        f"one of another, and a marker, turned at random: {search.found} of {search.things} "
        f"found, {search.wrong} finds of nothing; {search.time_median:.2f} s per picture, "
        "median."
    )
