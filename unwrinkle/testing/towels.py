"""Range maps of synthetic towels, and what was found of them beside the truth.

Truth is known in closed form: a Gaussian ridge of height h and sigma s has its inflections, the
contours, w = 2 s apart and h (1 - exp(-1/2)) below its top.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import GARMENT_CENTRE

SENSORS = ("stereo", "xtion", "tof")
#: Noise of one reading on flat cloth: sigma, m, and its correlation length, cells.
_NOISE = {"stereo": (0.0001, 0.0), "xtion": (0.002, 2.0), "tof": (0.004, 0.0)}
_XTION_STEP = 0.003  # m
_SIDE = 0.46  # m
_EXTENT = 0.5  # m


def map_of(
    towel: Towel,
    resolution: float,
    *,
    sensor: str = "stereo",
    noise: float = 0.0001,
    seed: int = 0,
    extent: float = _EXTENT,
) -> RangeMap:
    """Return the range map of a towel, `extent` metres square about its centre.

    Args:
        towel: that is seen.
        resolution: of the map, m.
        sensor: named in it.
        noise: standard deviation of white noise, m.
        seed: of the noise.
        extent: of the map, m.
    """
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
    """Return a map of flat cloth with a sensor's noise; an Xtion sees it in steps, from aslant."""
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
    """Make a towel with one Gaussian ridge in each quarter, of any direction, sigma and height."""
    rng = np.random.default_rng(seed)
    ridges = []
    for x in (-0.115, 0.115):
        for y in (-0.115, 0.115):
            sigma = rng.uniform(0.0075, 0.0135)
            ridges.append(
                Ridge(
                    centre=(GARMENT_CENTRE[0] + x, GARMENT_CENTRE[1] + y),
                    angle=rng.uniform(-math.pi / 2, math.pi / 2),
                    height=sigma * rng.uniform(0.8, 1.6),
                    sigma=sigma,
                    length=rng.uniform(0.10, 0.15),
                )
            )
    return Towel(ridges=tuple(ridges), centre=GARMENT_CENTRE, side=_SIDE, seed=seed)


def crossed_towel(seed: int) -> Towel:
    """Make a towel with two Gaussian ridges that cross at 40 to 90 degrees."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-math.pi / 2, math.pi / 2)
    turn = rng.uniform(math.radians(40.0), math.pi / 2)
    ridges = tuple(
        Ridge(centre=GARMENT_CENTRE, angle=a, height=1.2 * sigma, sigma=sigma, length=0.36)
        for a, sigma in ((angle, rng.uniform(0.009, 0.013)), (angle + turn, 0.011))
    )
    return Towel(ridges=ridges, centre=GARMENT_CENTRE, side=_SIDE, seed=seed)


def angle_between(direction: NDArray[np.float64], angle: float) -> float:
    """Return the angle between a direction (dx, dy) and a line at `angle`, senses aside, rad."""
    off = math.atan2(direction[1], direction[0]) - angle
    return abs((off + math.pi / 2) % math.pi - math.pi / 2)


def formula_width(ridge: Ridge) -> float:
    """Return the distance of the inflections: 2 sigma, m."""
    return 2.0 * ridge.sigma


def formula_chord_height(ridge: Ridge) -> float:
    """Return the height of the top over the inflections: (1 - exp(-1/2)) h, m."""
    return (1.0 - math.exp(-0.5)) * ridge.height


@dataclass(frozen=True)
class RidgeErrors:
    """What was found of a towel's ridges.

    Attributes:
        width, chord_height: absolute errors of the ridges that were found, m.
        direction: of the same, rad.
        missed: ridges without a wrinkle.
        extra: wrinkles without a ridge.
        ranking_kept: the wrinkles' order is that of Eq. 4 on the true widths and heights and the
            measured lengths; volumes within 5 % of each other are a tie.
    """

    width: tuple[float, ...]
    chord_height: tuple[float, ...]
    direction: tuple[float, ...]
    missed: int
    extra: int
    ranking_kept: bool


def compare(towel: Towel, analysis: Analysis) -> RidgeErrors:
    """Compare the wrinkles of an analysis with the ridges of its towel."""
    found: list[tuple[Ridge, Wrinkle]] = []
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
    return RidgeErrors(
        tuple(abs(w.width - formula_width(r)) for r, w in found),
        tuple(abs(w.chord_height - formula_chord_height(r)) for r, w in found),
        tuple(angle_between(w.direction, r.angle) for r, w in found),
        len(towel.ridges) - len(found),
        len(left),
        bool(np.all(ranked[1:] <= 1.05 * ranked[:-1])),
    )


def crossing_separated(towel: Towel, analysis: Analysis) -> bool:
    """Return whether each wrinkle runs along one of the ridges, and each ridge has a wrinkle."""
    owners = []
    for wrinkle in analysis.wrinkles:
        off = [angle_between(wrinkle.direction, ridge.angle) for ridge in towel.ridges]
        if min(off) > math.radians(3.0):
            return False
        owners.append(int(np.argmin(off)))
    return set(owners) == set(range(len(towel.ridges)))
