"""`unwrinkle bench analysis`: range map to flattening target: time, accuracy, false alarms.

Truth is known in closed form: a Gaussian ridge of height h and sigma s has its inflections, the
contours, w = 2 s apart and h (1 - exp(-1/2)) below its top.
"""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.harness.data import TABLE
from benchmarks.harness.report import Progress
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.perception.wrinkles.ridges import link, ridge_points
from unwrinkle.perception.wrinkles.surface import fit_surface
from unwrinkle.perception.wrinkles.targeting import flattening_target
from unwrinkle.perception.wrinkles.wrinkle import wrinkles_of
from unwrinkle.perception.wrinkles.wrinkledness import wrinkledness
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel

CENTRE = (0.0, -1.10)
SENSORS = ("stereo", "xtion", "tof")

#: Metres of noise of one reading on flat cloth, sigma over its correlation length in cells.
_NOISE = {"stereo": (0.0001, 0.0), "xtion": (0.002, 2.0), "tof": (0.004, 0.0)}
_XTION_STEP = 0.003
_SIDE = 0.46
_EXTENT = 0.5
_SIZES = ((1, 0.0005), (4, 0.00025), (16, 0.000125))


def map_of(
    towel: Towel,
    resolution: float,
    *,
    sensor: str = "stereo",
    noise: float = 0.0001,
    seed: int = 0,
    extent: float = _EXTENT,
) -> RangeMap:
    """Range map of a towel, `extent` metres square about its centre, with white noise (a sigma)."""
    count = round(extent / resolution)
    steps = (np.arange(count) - 0.5 * (count - 1)) * resolution
    x, y = np.meshgrid(towel.centre[0] + steps, towel.centre[1] + steps)
    rng = np.random.default_rng(seed)
    height = towel.height(x, y) + noise * rng.standard_normal(x.shape)
    return RangeMap(
        height=height.astype(np.float32),
        valid=np.ones(x.shape, dtype=bool),
        garment=towel.edge_distance(x, y) > 0.0,
        resolution=resolution,
        origin=np.array([x[0, 0], y[0, 0]]),
        table_height=towel.table_height,
        sensor=sensor,
    )


def flat_map(sensor: str, seed: int) -> RangeMap:
    """Flat cloth on the table with the sensor's noise; an Xtion sees it in steps, from aslant."""
    rng = np.random.default_rng(seed)
    towel = Towel(ridges=(), side=_SIDE, seed=seed)
    clean = map_of(
        towel, noise_profile(sensor).resolution, sensor=sensor, noise=0.0, extent=_EXTENT + 0.1
    )
    sigma, blotch = _NOISE[sensor]
    noise = rng.standard_normal(clean.shape)
    if blotch > 0.0:
        noise = gaussian_filter(noise, blotch)
    noise *= sigma / noise.std()
    height = clean.height + noise
    if sensor == "xtion":
        rows, columns = np.indices(clean.shape)
        tilt = rng.uniform(-0.05, 0.05, 2) * clean.resolution
        plane = tilt[0] * columns + tilt[1] * rows + rng.uniform(0.0, _XTION_STEP)
        height = np.rint((height + plane) / _XTION_STEP) * _XTION_STEP - plane
    return RangeMap(
        height=height.astype(np.float32),
        valid=clean.valid,
        garment=clean.garment,
        resolution=clean.resolution,
        origin=clean.origin,
        table_height=clean.table_height,
        sensor=sensor,
    )


def ridged_towel(seed: int) -> Towel:
    """A towel with one Gaussian ridge in each quarter, of any direction, sigma and height."""
    rng = np.random.default_rng(seed)
    ridges = []
    for x in (-0.115, 0.115):
        for y in (-0.115, 0.115):
            sigma = rng.uniform(0.0075, 0.0135)
            ridges.append(
                Ridge(
                    centre=(CENTRE[0] + x, CENTRE[1] + y),
                    angle=rng.uniform(-math.pi / 2, math.pi / 2),
                    height=sigma * rng.uniform(0.8, 1.6),
                    sigma=sigma,
                    length=rng.uniform(0.10, 0.15),
                )
            )
    return Towel(ridges=tuple(ridges), centre=CENTRE, side=_SIDE, seed=seed)


def crossed_towel(seed: int) -> Towel:
    """A towel with two Gaussian ridges that cross at 40 to 90 degrees."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-math.pi / 2, math.pi / 2)
    turn = rng.uniform(math.radians(40.0), math.pi / 2)
    ridges = tuple(
        Ridge(centre=CENTRE, angle=a, height=1.2 * sigma, sigma=sigma, length=0.36)
        for a, sigma in ((angle, rng.uniform(0.009, 0.013)), (angle + turn, 0.011))
    )
    return Towel(ridges=ridges, centre=CENTRE, side=_SIDE, seed=seed)


def angle_between(direction: NDArray[np.float64], angle: float) -> float:
    """Angle between a direction (dx, dy) and a line at `angle`, both without sense, radians."""
    off = math.atan2(direction[1], direction[0]) - angle
    return abs((off + math.pi / 2) % math.pi - math.pi / 2)


def formula_width(ridge: Ridge) -> float:
    """Distance of the inflections: 2 sigma, metres."""
    return 2.0 * ridge.sigma


def formula_chord_height(ridge: Ridge) -> float:
    """Height of the top over the inflections: (1 - exp(-1/2)) h, metres."""
    return (1.0 - math.exp(-0.5)) * ridge.height


def compare(towel: Towel, analysis: Analysis) -> dict[str, Any]:
    """Errors of the wrinkles against the towel's ridges; metres, radians.

    Returns:
        width, chord_height, direction: lists of absolute errors of the ridges that were found;
        missed, extra: ridges without a wrinkle and wrinkles without a ridge; ranking_kept: whether
        the wrinkles' order is that of Eq. 4 on the true widths and heights and measured lengths.
    """
    found: list[tuple[Ridge, Any]] = []
    left = list(analysis.wrinkles)
    for ridge in towel.ridges:
        near = [w for w in left if np.hypot(*(w.centre - np.array(ridge.centre))) < 0.03]
        if near:
            found.append((ridge, near[0]))
            left = [w for w in left if w is not near[0]]
    true_volume = [
        w.length * formula_width(ridge) * formula_chord_height(ridge) for ridge, w in found
    ]
    order = np.argsort([-w.volume_score for _, w in found])
    ranked = np.array(true_volume)[order]
    return {
        "width": [abs(w.width - formula_width(r)) for r, w in found],
        "chord_height": [abs(w.chord_height - formula_chord_height(r)) for r, w in found],
        "direction": [angle_between(w.direction, r.angle) for r, w in found],
        "missed": len(towel.ridges) - len(found),
        "extra": len(left),
        # Volumes within 5 % of each other are a tie.
        "ranking_kept": bool(np.all(ranked[1:] <= 1.05 * ranked[:-1])),
    }


def crossing_separated(towel: Towel, analysis: Analysis) -> bool:
    """Whether each wrinkle runs along one of the ridges, and each ridge has a wrinkle."""
    owners = []
    for wrinkle in analysis.wrinkles:
        off = [angle_between(wrinkle.direction, ridge.angle) for ridge in towel.ridges]
        if min(off) > math.radians(3.0):
            return False
        owners.append(int(np.argmin(off)))
    return set(owners) == set(range(len(towel.ridges)))


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Measure. See the module; times in seconds, lengths in metres, angles in radians."""
    towels, crossings, flats = (10, 10, 10) if quick else (50, 50, 50)
    results: dict[str, Any] = {}
    errors: dict[str, list[float]] = {"width": [], "chord_height": [], "direction": []}
    missed = extra = kept = 0
    for k in range(towels):
        progress(k, towels, "ridges")
        towel = ridged_towel(seed + k)
        outcome = compare(towel, analyse(map_of(towel, 0.0005, seed=seed + k), table=TABLE))
        for name, values in errors.items():
            values.extend(outcome[name])
        missed += outcome["missed"]
        extra += outcome["extra"]
        kept += outcome["ranking_kept"]
    separated = 0
    for k in range(crossings):
        progress(k, crossings, "crossings")
        towel = crossed_towel(seed + k)
        separated += crossing_separated(
            towel, analyse(map_of(towel, 0.0005, seed=seed + k), table=TABLE)
        )
    results |= {
        "towels": towels,
        "ridges": sum(len(ridged_towel(seed + k).ridges) for k in range(towels)),
        "ridges_missed": missed,
        "wrinkles_extra": extra,
        "width_error_max": max(errors["width"]),
        "width_error_median": float(np.median(errors["width"])),
        "chord_height_error_max": max(errors["chord_height"]),
        "chord_height_error_median": float(np.median(errors["chord_height"])),
        "direction_error_max": max(errors["direction"]),
        "ranking_kept_fraction": kept / towels,
        "crossings": crossings,
        "crossings_separated_fraction": separated / crossings,
    }
    results["flat_cloth"] = _flat_cloth(flats, seed, progress)
    results["times"] = _times(quick, seed, progress)
    results["range_map_to_target_time_median"] = results["times"][0]["median"]
    results["stages"] = _stages(seed, 5 if quick else 15)
    results["wrinkledness_time_median"] = _wrinkledness_time(seed, 5 if quick else 15)
    return results


def _flat_cloth(seeds: int, seed: int, progress: Progress) -> dict[str, Any]:
    worst = {}
    for sensor in SENSORS:
        pulls, false_alarms = [], 0
        for k in range(seeds):
            progress(k, seeds, f"flat cloth, {sensor}")
            analysis = analyse(flat_map(sensor, seed + k), table=TABLE)
            pulls.append(analysis.halting_measure)
            false_alarms += analysis.halting_measure >= analysis.profile.halting_pull
        worst[sensor] = {"seeds": seeds, "false_alarms": false_alarms, "pull_max": max(pulls)}
    return worst


def _times(quick: bool, seed: int, progress: Progress) -> list[dict[str, Any]]:
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
            {
                "megapixels": megapixels,
                "resolution": resolution,
                "median": float(np.median(samples)),
                "max": max(samples),
                "runs": len(samples),
            }
        )
    return times


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


def table(results: dict[str, Any]) -> str:
    """Return the results as Markdown."""
    rows = [
        "| range map | cells of | median | worst | runs |",
        "|---|---|---|---|---|",
    ]
    rows += [
        f"| {t['megapixels']} MP | {1e3 * t['resolution']:.3f} mm | {1e3 * t['median']:.0f} ms "
        f"| {1e3 * t['max']:.0f} ms | {t['runs']} |"
        for t in results["times"]
    ]
    rows += ["", "| stage, 1 MP | median |", "|---|---|"]
    rows += [f"| {name} | {1e3 * taken:.1f} ms |" for name, taken in results["stages"].items()]
    rows += [
        f"| wrinkledness, 640 x 480 | {1e3 * results['wrinkledness_time_median']:.0f} ms |",
        "",
        f"{results['ridges']} Gaussian ridges on {results['towels']} towels, 0.1 mm of noise:",
        "",
        "| | worst | median |",
        "|---|---|---|",
        (
            f"| width against 2 sigma | {1e3 * results['width_error_max']:.2f} mm "
            f"| {1e3 * results['width_error_median']:.2f} mm |"
        ),
        (
            f"| chord height against (1 - exp(-1/2)) h | {1e3 * results['chord_height_error_max']:.2f} "
            f"mm | {1e3 * results['chord_height_error_median']:.2f} mm |"
        ),
        f"| direction | {math.degrees(results['direction_error_max']):.2f} deg | |",
        "",
        (
            f"Missed ridges {results['ridges_missed']}, wrinkles too many {results['wrinkles_extra']}, "
            f"ranking kept on {results['ranking_kept_fraction']:.0%} of the towels, two crossing ridges "
            f"kept apart in {results['crossings_separated_fraction']:.0%} of {results['crossings']}."
        ),
        "",
        "| flat cloth | seeds | above the halting measure | largest pull |",
        "|---|---|---|---|",
    ]
    rows += [
        f"| {name} | {flat['seeds']} | {flat['false_alarms']} | {1e3 * flat['pull_max']:.2f} mm |"
        for name, flat in results["flat_cloth"].items()
    ]
    return "\n".join(rows) + "\n"
