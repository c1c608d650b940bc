"""A wrinkle and its measures: curve, triplets, width, height, volume and pull distance.

Equations are those of the source paper (dual-arm flattening with a stereo head), corrected:
Eq. 2 takes the square root of Heron's product (without it the height comes out in m^3), Eq. 4 and 5
average over the matched triplets and Eq. 4 takes its logarithms of millimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from unwrinkle.models.choices import PullReading
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.cross_section import CrossSectionSide
from unwrinkle.perception.wrinkles.ridges import Line
from unwrinkle.perception.wrinkles.surface import Surface

Vectors = NDArray[np.float64]

#: Eq. 5's coefficient.
PULL_COEFFICIENT = 1.10

#: A crest falls off to both sides, the edge of a cloth layer to one (the smoothed step overshoots,
#: hence to a quarter on the other): least ratio of the two falls, in the median triplet. On real
#: captures layers' edges lie below 0.35 and folds above 0.5.
LEAST_FALL_RATIO = 0.4

#: Lower ridges are the cloth's own texture, or the ripple that a smoothed step leaves beside it.
LEAST_PEAK = 0.001

#: Of the samples along a ridge, at least this share must have contours on both sides.
LEAST_YIELD = 0.5

#: A curve of degree 5 must be longer than this many shortest wrinkles; degree 2 otherwise.
QUINTIC_LENGTHS = 2.0

#: A ridge line that its curve misses by more than this share of its extent (rms) is cut in two.
MOST_MISFIT = 0.04

#: So is one whose curve turns further than this from its principal direction (slope of 50 deg): a
#: wrinkle has one direction, and is pulled square to it.
MOST_SLOPE = 1.2


@dataclass(frozen=True, eq=False)
class Wrinkle:
    """One wrinkle, in the world frame W, metres.

    Attributes:
        centre: (2,) point of the ridge line half-way along its length.
        direction: (2,) unit, principal direction of the curve; x > 0, or x = 0 and y > 0.
        length: arc length of the ridge line on the surface, where it has contours.
        width: median distance between the contours (2 sigma of a Gaussian ridge).
        chord_height: median height of the ridge over the line between its contours, Eq. 2
            corrected: 1 - exp(-1/2) = 0.39 of a Gaussian ridge's height.
        peak_height: median height of the ridge over the line between its feet.
        volume_score: Eq. 4, log(length) + log(mean(width * height)), in millimetres.
        pull_distance_paper: Eq. 5 between the contours.
        pull_distance_foot: Eq. 5 between the feet: all of the slack.
        curve: (n, 3) points of the ridge line.
        crests: (nt, 3) the ridge point of each triplet.
        contours: two (nt, 3) arrays, the contour points on the -n and +n side, n = (-dy, dx).
        samples: number of points along the ridge where triplets were sought.
        triplets: number of triplets found, nt.
    """

    centre: Vectors
    direction: Vectors
    length: float
    width: float
    chord_height: float
    peak_height: float
    volume_score: float
    pull_distance_paper: float
    pull_distance_foot: float
    curve: Vectors
    crests: Vectors
    contours: tuple[Vectors, Vectors]
    samples: int
    triplets: int

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.centre, self.direction, self.curve, self.crests, *self.contours):
            array.setflags(write=False)

    @property
    def normal(self) -> Vectors:
        """(2,) unit normal n = (-dy, dx) of the direction."""
        return np.array([-self.direction[1], self.direction[0]])

    def pull_distance(self, mode: str) -> float:
        """Return the pull distance by one `PullReading` of Eq. 5, metres.

        Raises:
            InputError: an unknown reading.
        """
        contour, foot = self.pull_distance_paper, self.pull_distance_foot
        match PullReading(mode):
            case PullReading.FOOT:
                return foot
            case PullReading.CONTOUR:
                return contour
            case PullReading.MEAN:
                return 0.5 * (contour + foot)

    def to_json(self, *, points: bool = False) -> dict[str, Any]:
        """Return plain numbers and lists; the point lists only if asked for."""
        plain: dict[str, Any] = {
            "centre": self.centre.tolist(),
            "direction": self.direction.tolist(),
            "angle": math.atan2(self.direction[1], self.direction[0]),
            "length": self.length,
            "width": self.width,
            "chord_height": self.chord_height,
            "peak_height": self.peak_height,
            "volume_score": self.volume_score,
            "pull_distance_paper": self.pull_distance_paper,
            "pull_distance_foot": self.pull_distance_foot,
            "samples": self.samples,
            "triplets": self.triplets,
        }
        if points:
            plain["curve"] = self.curve.tolist()
            plain["crests"] = self.crests.tolist()
            plain["contours"] = [contour.tolist() for contour in self.contours]
        return plain


def triplet_height(a: Vectors, b: Vectors, c: Vectors) -> Vectors:
    """Height of triangles over side c, Eq. 2 corrected: 2 sqrt(d(d-a)(d-b)(d-c)) / c.

    The paper's numerator is meant to be the triangle's area but lacks Heron's square root. The
    product is clamped at 0 (it goes slightly negative in floats); c = 0 gives 0.
    """
    d = 0.5 * (a + b + c)
    heron = np.maximum(d * (d - a) * (d - b) * (d - c), 0.0)
    return np.asarray(2.0 * np.sqrt(heron) / np.where(c > 0.0, c, np.inf))


def volume_score(length: float, widths: Vectors, heights: Vectors) -> float:
    """Eq. 4: log(length) + log(mean over the matched triplets of width * height), in mm."""
    return math.log(1e3 * length) + math.log(1e6 * float(np.mean(widths * heights)))


def wrinkles_of(line: Line, surface: Surface, profile: NoiseProfile, table: float) -> list[Wrinkle]:
    """Measure the wrinkle(s) along one linked ridge line.

    A line that no single curve fits (it turns back on itself) gives more than one. Lines without
    enough triplets, too low for their length to be told from the sensor's noise, or falling off to
    one side only (the edge of a cloth layer lying on another) give none. A triplet counts only where
    both feet of the ridge stand on the garment: where the cloth rolls down to the table it is its
    rim.

    Args:
        line: (n, 2) ordered (column, row) on the surface's grid.
        surface: the fitted surface.
        profile: the sensor's profile.
        table: world z of the table, metres.
    """
    wrinkles = []
    for curve, across in _curves(line, surface, profile):
        flanks = _both_sides(curve, across, surface, profile, fine=True)
        found = flanks[0].found & flanks[1].found
        crest = found
        if surface.fine[0] is not surface.z:
            coarse = _both_sides(curve, across, surface, profile, fine=False)
            crest = coarse[0].found & coarse[1].found
            falls = _falls(coarse)
        else:
            falls = _falls(flanks)
        for run in _runs(found, round(profile.link_gap / profile.triplet_spacing)):
            if not _is_crest(falls[:, run], crest[run]):
                continue
            wrinkle = _measure(curve, flanks, found, run, surface, profile, table)
            if wrinkle is not None:
                wrinkles.append(wrinkle)
    return wrinkles


def _both_sides(
    curve: Line, across: Line, surface: Surface, profile: NoiseProfile, *, fine: bool
) -> tuple[CrossSectionSide, CrossSectionSide]:
    return (
        CrossSectionSide(curve, -across, surface, profile, fine=fine),
        CrossSectionSide(curve, across, surface, profile, fine=fine),
    )


def _falls(flanks: tuple[CrossSectionSide, CrossSectionSide]) -> Vectors:
    """Heights (2, samples) of the ridge over its feet, metres."""
    return np.stack([flank.z[:, 0] - flank.at(flank.foot)[1] for flank in flanks])


def _is_crest(falls: Vectors, found: NDArray[np.bool_]) -> bool:
    """Whether the ridge falls off to both sides; judged on the smoother surface, which rings less.

    Next to a sharp step the finer surface overshoots enough to look like a ridge.
    """
    if np.count_nonzero(found) < LEAST_YIELD * len(found):
        return False
    falls = falls[:, found]
    ratios = falls.min(axis=0) / np.maximum(falls.max(axis=0), 1e-9)
    return float(np.median(ratios)) >= LEAST_FALL_RATIO


def _runs(found: NDArray[np.bool_], gap: int) -> list[slice]:
    """Stretches of samples from triplet to triplet, with at most `gap` samples without between."""
    where = np.flatnonzero(found)
    if len(where) == 0:
        return []
    breaks = np.flatnonzero(np.diff(where) > gap)
    starts = where[np.concatenate([[0], breaks + 1])]
    ends = where[np.concatenate([breaks, [len(where) - 1]])]
    return [slice(int(a), int(b) + 1) for a, b in zip(starts, ends, strict=True)]


def _curves(line: Line, surface: Surface, profile: NoiseProfile) -> list[tuple[Line, Line]]:
    """Fit the line by y(x) in its own principal frame; return sampled points and unit normals.

    Degree 5 on an argument scaled to +-1; degree 2 when the line is short. A line that is not one
    y(x) is cut where it lies furthest from the chord between its ends.
    """
    centre = line.mean(axis=0)
    _, _, axes = np.linalg.svd(line - centre, full_matrices=False)
    along, aside = (line - centre) @ axes[0], (line - centre) @ axes[1]
    extent = float(np.ptp(along))
    if extent < profile.shortest_ridge / surface.resolution:
        return []
    scale = float(np.abs(along).max())
    quintic = QUINTIC_LENGTHS * profile.wrinkle_length / surface.resolution
    degree = 5 if extent >= quintic else 2
    fit = Polynomial.fit(along / scale, aside / scale, degree, domain=[-1.0, 1.0])
    misfit = float(np.sqrt(np.mean((fit(along / scale) * scale - aside) ** 2)))
    turned = float(
        np.abs(fit.deriv()(np.quantile(along, np.linspace(0.05, 0.95, 19)) / scale)).max()
    )
    if misfit > max(MOST_MISFIT * extent, 2.0) or turned > MOST_SLOPE:
        chord = line[-1] - line[0]
        off = chord[0] * (line[:, 1] - line[0, 1]) - chord[1] * (line[:, 0] - line[0, 0])
        middle = int(np.argmax(np.abs(off)))
        if 2 < middle < len(line) - 3:
            halves = line[: middle + 1], line[middle:]
            return [curve for half in halves for curve in _curves(half, surface, profile)]
    count = max(3, round(extent * surface.resolution / profile.triplet_spacing) + 1)
    t = np.linspace(along.min(), along.max(), count) / scale
    slope = fit.deriv()(t)[:, None]
    points = centre + scale * (t[:, None] * axes[0] + fit(t)[:, None] * axes[1])
    normals = (axes[1] - slope * axes[0]) / np.sqrt(1.0 + slope**2)
    if axes[0] @ np.array([normals[0, 1], -normals[0, 0]]) < 0.0:
        normals = -normals  # normal = (-dy, dx) of the tangent, for the two sides' names
    return [(points, normals)]


def _measure(
    curve: Line,
    flanks: tuple[CrossSectionSide, CrossSectionSide],
    found: NDArray[np.bool_],
    run: slice,
    surface: Surface,
    profile: NoiseProfile,
    table: float,
) -> Wrinkle | None:
    ok = np.zeros_like(found)
    ok[run] = found[run]
    count = int(np.count_nonzero(ok))
    samples = run.stop - run.start
    if count < max(3.0, LEAST_YIELD * samples):
        return None

    def world(points: Line, height: NDArray[Any]) -> Vectors:
        return np.column_stack([surface.world(points), height + table])

    crests = world(curve, flanks[0].z[:, 0])
    contours, feet, arcs_contour, arcs_foot = [], [], [], []
    for flank in flanks:
        points, height, arc = flank.at(flank.contour)
        contours.append(world(points, height)[ok])
        arcs_contour.append(arc[ok])
        points, height, arc = flank.at(flank.foot)
        feet.append(world(points, height)[ok])
        arcs_foot.append(arc[ok])
    peaks, ridge = crests[ok], crests[run]
    pieces = np.linalg.norm(np.diff(ridge, axis=0), axis=1)
    length = float(pieces.sum())
    peak_height = float(np.median(_height_over(peaks, feet[0], feet[1])))
    if peak_height < max(profile.least_height(length), LEAST_PEAK):
        return None
    widths = np.linalg.norm(contours[1] - contours[0], axis=1)
    heights = triplet_height(
        np.linalg.norm(peaks - contours[0], axis=1),
        np.linalg.norm(peaks - contours[1], axis=1),
        widths,
    )
    base = np.linalg.norm(feet[1] - feet[0], axis=1)
    along = np.concatenate([[0.0], np.cumsum(pieces)])
    centre = np.array([np.interp(0.5 * length, along, ridge[:, i]) for i in (0, 1)])
    direction = np.linalg.svd(ridge[:, :2] - ridge[:, :2].mean(axis=0), full_matrices=False)[2][0]
    if direction[0] < 0.0 or (direction[0] == 0.0 and direction[1] < 0.0):
        direction = -direction
    if direction @ (ridge[-1, :2] - ridge[0, :2]) < 0.0:
        contours = contours[::-1]
    return Wrinkle(
        centre=centre,
        direction=direction,
        length=length,
        width=float(np.median(widths)),
        chord_height=float(np.median(heights)),
        peak_height=peak_height,
        volume_score=volume_score(length, widths, heights),
        pull_distance_paper=PULL_COEFFICIENT * float(np.mean(sum(arcs_contour) - widths)),
        pull_distance_foot=PULL_COEFFICIENT * float(np.mean(sum(arcs_foot) - base)),
        curve=ridge,
        crests=peaks,
        contours=(contours[0], contours[1]),
        samples=samples,
        triplets=count,
    )


def _height_over(points: Vectors, starts: Vectors, ends: Vectors) -> Vectors:
    """Heights of points over the lines from starts to ends, all (n, 3), straight above."""
    span = ends - starts
    squared = np.maximum(np.sum(span[:, :2] ** 2, axis=1), 1e-12)
    share = np.sum((points - starts)[:, :2] * span[:, :2], axis=1) / squared
    return np.asarray(points[:, 2] - starts[:, 2] - share * span[:, 2])
