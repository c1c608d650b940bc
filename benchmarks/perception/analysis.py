"""`unwrinkle bench analysis`: range map to flattening target: time, accuracy, false alarms.

Truth is known in closed form: a Gaussian ridge of height h and sigma s has its inflections, the
contours, w = 2 s apart and h (1 - exp(-1/2)) below its top.
"""

import math
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.perception.wrinkles.ridges import link, ridge_points
from unwrinkle.perception.wrinkles.surface import fit_surface
from unwrinkle.perception.wrinkles.targeting import flattening_target
from unwrinkle.perception.wrinkles.wrinkle import wrinkles_of
from unwrinkle.perception.wrinkles.wrinkledness import wrinkledness
from unwrinkle.testing.table import TABLE
from unwrinkle.testing.towels import (
    SENSORS,
    compare,
    crossed_towel,
    crossing_separated,
    flat_map,
    map_of,
    ridged_towel,
)

#: Megapixels of a map, and its resolution, m.
_SIZES = ((1, 0.0005), (4, 0.00025), (16, 0.000125))


@dataclass(frozen=True)
class FlatCloth:
    """Maps of flat cloth: seeds, those above the halting measure, largest pull, m."""

    seeds: int
    false_alarms: int
    pull_max: float


@dataclass(frozen=True)
class SizeTimes:
    """Range map to target at one size: megapixels, resolution, m, and times, s."""

    megapixels: int
    resolution: float
    median: float
    max: float
    runs: int


@dataclass(frozen=True)
class AnalysisResult:
    """Errors against closed forms, lengths in m, angles in rad; times in s."""

    towels: int
    ridges: int
    ridges_missed: int
    wrinkles_extra: int
    width_error_max: float
    width_error_median: float
    chord_height_error_max: float
    chord_height_error_median: float
    direction_error_max: float
    ranking_kept_fraction: float
    crossings: int
    crossings_separated_fraction: float
    flat_cloth: dict[str, FlatCloth]
    times: tuple[SizeTimes, ...]
    range_map_to_target_time_median: float
    stages: dict[str, float]
    wrinkledness_time_median: float


def run(*, quick: bool, seed: int, progress: Progress) -> AnalysisResult:
    """Measure. See the module; times in seconds, lengths in metres, angles in radians."""
    towels, crossings, flats = (10, 10, 10) if quick else (50, 50, 50)
    errors: dict[str, list[float]] = {"width": [], "chord_height": [], "direction": []}
    missed = extra = kept = 0
    for k in range(towels):
        progress(k, towels, "ridges")
        towel = ridged_towel(seed + k)
        outcome = compare(towel, analyse(map_of(towel, 0.0005, seed=seed + k), table=TABLE))
        for name, values in errors.items():
            values.extend(getattr(outcome, name))
        missed += outcome.missed
        extra += outcome.extra
        kept += outcome.ranking_kept
    separated = 0
    for k in range(crossings):
        progress(k, crossings, "crossings")
        towel = crossed_towel(seed + k)
        separated += crossing_separated(
            towel, analyse(map_of(towel, 0.0005, seed=seed + k), table=TABLE)
        )
    times = _times(quick, seed, progress)
    return AnalysisResult(
        towels=towels,
        ridges=sum(len(ridged_towel(seed + k).ridges) for k in range(towels)),
        ridges_missed=missed,
        wrinkles_extra=extra,
        width_error_max=max(errors["width"]),
        width_error_median=float(np.median(errors["width"])),
        chord_height_error_max=max(errors["chord_height"]),
        chord_height_error_median=float(np.median(errors["chord_height"])),
        direction_error_max=max(errors["direction"]),
        ranking_kept_fraction=kept / towels,
        crossings=crossings,
        crossings_separated_fraction=separated / crossings,
        flat_cloth=_flat_cloth(flats, seed, progress),
        times=times,
        range_map_to_target_time_median=times[0].median,
        stages=_stages(seed, 5 if quick else 15),
        wrinkledness_time_median=_wrinkledness_time(seed, 5 if quick else 15),
    )


def _flat_cloth(seeds: int, seed: int, progress: Progress) -> dict[str, FlatCloth]:
    worst = {}
    for sensor in SENSORS:
        pulls, false_alarms = [], 0
        for k in range(seeds):
            progress(k, seeds, f"flat cloth, {sensor}")
            analysis = analyse(flat_map(sensor, seed + k), table=TABLE)
            pulls.append(analysis.halting_measure)
            false_alarms += analysis.halting_measure >= analysis.profile.halting_pull
        worst[sensor] = FlatCloth(seeds, false_alarms, max(pulls))
    return worst


def _times(quick: bool, seed: int, progress: Progress) -> tuple[SizeTimes, ...]:
    towel = ridged_towel(seed)
    times = []
    for index, (megapixels, resolution) in enumerate(_SIZES):
        progress(index, len(_SIZES), f"{megapixels} MP")
        range_map = map_of(towel, resolution, seed=seed)
        samples = []
        for _ in range(5 if quick else 15):
            start = time.perf_counter()
            target = analyse(range_map, table=TABLE).target_for(0)
            samples.append(time.perf_counter() - start)
            assert isinstance(target, FlatteningTarget)
        times.append(
            SizeTimes(
                megapixels=megapixels,
                resolution=resolution,
                median=float(np.median(samples)),
                max=max(samples),
                runs=len(samples),
            )
        )
    return tuple(times)


def _stages(seed: int, runs: int) -> dict[str, float]:
    """Median time of each stage at 1 MP."""
    range_map, profile = map_of(ridged_towel(seed), 0.0005, seed=seed), noise_profile("stereo")
    marks: dict[str, list[float]] = {}
    for _ in range(runs):
        clock = [time.perf_counter()]
        surface = fit_surface(range_map, profile)
        clock.append(time.perf_counter())
        ridge = ridge_points(surface, profile)
        clock.append(time.perf_counter())
        lines = link(ridge, surface, profile)
        clock.append(time.perf_counter())
        table = range_map.table_height
        wrinkles = [w for line in lines for w in wrinkles_of(line, surface, profile, table)]
        clock.append(time.perf_counter())
        flattening_target(range_map, surface, wrinkles[0], table=TABLE)
        clock.append(time.perf_counter())
        names = ("surface and classes", "ridge points", "linking", "wrinkles", "target")
        for name, taken in zip(names, np.diff(clock), strict=True):
            marks.setdefault(name, []).append(float(taken))
    return {name: float(np.median(values)) for name, values in marks.items()}


def _wrinkledness_time(seed: int, runs: int) -> float:
    """Median time of wrinkledness at 640 x 480 samples of the surface."""
    towel = ridged_towel(seed)
    square = map_of(towel, 0.001, seed=seed, extent=0.64)
    range_map = RangeMap(
        height=square.height[80:560],
        valid=square.valid[80:560],
        garment=np.ones((480, 640), dtype=bool),
        resolution=square.resolution,
        origin=square.origin + np.array([0.0, 80 * square.resolution]),
        table_height=square.table_height,
        sensor=square.sensor,
    )
    profile = noise_profile("stereo")
    surface = fit_surface(range_map, profile)
    samples = []
    for _ in range(runs):
        start = time.perf_counter()
        wrinkledness(surface, profile)
        samples.append(time.perf_counter() - start)
    return float(np.median(samples))


def table(results: AnalysisResult) -> str:
    """Return the results as Markdown."""
    rows = [
        line("range map", "cells of", "median", "worst", "runs"),
        rule(5),
    ]
    rows += [
        line(
            f"{t.megapixels} MP",
            f"{1e3 * t.resolution:.3f} mm",
            f"{1e3 * t.median:.0f} ms",
            f"{1e3 * t.max:.0f} ms",
            f"{t.runs}",
        )
        for t in results.times
    ]
    rows += ["", line("stage, 1 MP", "median"), rule(2)]
    rows += [line(f"{name}", f"{1e3 * taken:.1f} ms") for name, taken in results.stages.items()]
    rows += [
        line("wrinkledness, 640 x 480", f"{1e3 * results.wrinkledness_time_median:.0f} ms"),
        "",
        f"{results.ridges} Gaussian ridges on {results.towels} towels, 0.1 mm of noise:",
        "",
        line("", "worst", "median"),
        rule(3),
        (
            line(
                "width against 2 sigma",
                f"{1e3 * results.width_error_max:.2f} mm",
                f"{1e3 * results.width_error_median:.2f} mm",
            )
        ),
        (
            line(
                "chord height against (1 - exp(-1/2)) h",
                f"{1e3 * results.chord_height_error_max:.2f} mm",
                f"{1e3 * results.chord_height_error_median:.2f} mm",
            )
        ),
        line("direction", f"{math.degrees(results.direction_error_max):.2f} deg", ""),
        "",
        (
            f"Missed ridges {results.ridges_missed}, wrinkles too many {results.wrinkles_extra}, "
            f"ranking kept on {results.ranking_kept_fraction:.0%} of the towels, two crossing ridges "
            f"kept apart in {results.crossings_separated_fraction:.0%} of {results.crossings}."
        ),
        "",
        line("flat cloth", "seeds", "above the halting measure", "largest pull"),
        rule(4),
    ]
    rows += [
        line(f"{name}", f"{flat.seeds}", f"{flat.false_alarms}", f"{1e3 * flat.pull_max:.2f} mm")
        for name, flat in results.flat_cloth.items()
    ]
    return "\n".join(rows) + "\n"
