"""Wrinkle measurement: ridge curve, triplets, width, height, volume score and pull distance.

Equation numbers are those of the source paper (dual-arm flattening with a stereo head), with these
corrections: Eq. 2 takes the square root of Heron's product (otherwise the height is in m^3), Eq. 4
and 5 average over the matched triplets, and Eq. 4 takes logarithms of lengths in millimetres.
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

#: Coefficient of Eq. 5.
PULL_COEFFICIENT = 1.10

#: Least ratio of the descents to both sides of a crest, median over the triplets. The edge of a
#: cloth layer descends to one side (to about a quarter on the other, because the smoothed step
#: overshoots). On real captures layer edges are below 0.35, folds above 0.5.
LEAST_FALL_RATIO = 0.4

#: Least ridge height, metres; lower ones are cloth texture or the overshoot beside a smoothed step.
LEAST_PEAK = 0.001

#: Least fraction of the samples along a ridge that must have contours on both sides. Where one foot
#: runs into a neighbour, a shadow or the rim, the ridge goes on without being measured.
LEAST_YIELD = 0.25

#: Length of the pieces in which a ridge is judged, multiples of `wrinkle_length`: a part that is
#: the edge of a layer is cut off, and does not spoil the rest.
PIECE_LENGTHS = 0.5

#: Least length of a curve of degree 5, multiples of `wrinkle_length`; shorter curves get degree 2.
QUINTIC_LENGTHS = 2.0

#: RMS misfit of the curve, as a fraction of its extent, above which a ridge line is cut in two.
MOST_MISFIT = 0.04

#: Slope of the curve against its principal direction (50 deg) above which it is cut in two: the
#: pull is perpendicular to the principal direction.
MOST_SLOPE = 1.2


@dataclass(frozen=True, eq=False)
class Wrinkle:
    """One wrinkle. World frame W, metres.

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
        pull_distance_foot: Eq. 5 between the feet, which covers all of the slack.
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
        """Unit normal (2,) of the direction (dx, dy): (-dy, dx)."""
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
        """Return plain numbers and lists; with `points`, also the point lists."""
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
    """Return the height of triangles over side c, metres: 2 sqrt(d(d-a)(d-b)(d-c)) / c.

    This is Eq. 2 with the square root of Heron's formula that the source paper lacks;
    d = (a + b + c) / 2. The product is clamped at 0 against rounding; c = 0 gives 0.
    """
    d = 0.5 * (a + b + c)
    heron = np.maximum(d * (d - a) * (d - b) * (d - c), 0.0)
    return np.asarray(2.0 * np.sqrt(heron) / np.where(c > 0.0, c, np.inf))


def volume_score(length: float, widths: Vectors, heights: Vectors) -> float:
    """Return Eq. 4: log(length) + log(mean of width * height over the triplets), lengths in mm."""
    return math.log(1e3 * length) + math.log(1e6 * float(np.mean(widths * heights)))


def wrinkles_of(line: Line, surface: Surface, profile: NoiseProfile, table: float) -> list[Wrinkle]:
    """Measure the wrinkles along one linked ridge line.

    A line that no single curve fits is cut and gives several wrinkles. A line gives none if it has
    too few triplets, is too low for its length to be distinguished from the sensor's noise, or
    descends to one side only (the edge of a cloth layer on another). Triplets whose feet are not
    both on the garment are left out (the garment's rim).

    Args:
        line: (n, 2) ordered (column, row) on the surface's grid.
        surface: the fitted surface.
        profile: the sensor's profile.
        table: world z of the table, metres.
    """
    wrinkles = []
    for curve, across in _curves(line, surface, profile):
        sides = _both_sides(curve, across, surface, profile, fine=True)
        found = sides[0].found & sides[1].found
        crest = found
        if surface.fine[0] is not surface.z:
            coarse = _both_sides(curve, across, surface, profile, fine=False)
            crest = coarse[0].found & coarse[1].found
            falls = _falls(coarse)
        else:
            falls = _falls(sides)
        ridge = (sides[0].found | sides[1].found) & _crests(falls, crest, profile)
        for run in _runs(ridge, round(profile.link_gap / profile.triplet_spacing)):
            wrinkle = _measure(curve, sides, found, run, surface, profile, table)
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


def _falls(sides: tuple[CrossSectionSide, CrossSectionSide]) -> Vectors:
    """Return the heights (2, samples) of the ridge over its two feet, metres."""
    return np.stack([side.z[:, 0] - side.at(side.foot)[1] for side in sides])


def _crests(falls: Vectors, found: NDArray[np.bool_], profile: NoiseProfile) -> NDArray[np.bool_]:
    """Return the samples (n,) of the parts of a line that descend to both sides.

    A piece without samples that show both sides goes with its nearest judged neighbour. Callers
    pass heights of the smoother surface: beside a sharp step the finer one overshoots enough to
    resemble a ridge.
    """
    count = len(found)
    size = max(2, round(PIECE_LENGTHS * profile.wrinkle_length / profile.triplet_spacing))
    pieces = np.array_split(np.arange(count), max(1, round(count / size)))
    ratios = falls.min(axis=0) / np.maximum(falls.max(axis=0), 1e-9)
    judged = [piece[found[piece]] for piece in pieces]
    known = [k for k, piece in enumerate(judged) if len(piece) >= 2]
    crest = np.zeros(count, dtype=bool)
    for k, piece in enumerate(pieces):
        if known:
            nearest = judged[min(known, key=lambda other: abs(other - k))]
            crest[piece] = float(np.median(ratios[nearest])) >= LEAST_FALL_RATIO
    return crest


def _runs(found: NDArray[np.bool_], gap: int) -> list[slice]:
    """Return the runs of samples of a ridge, allowing gaps of at most `gap` samples."""
    where = np.flatnonzero(found)
    if len(where) == 0:
        return []
    breaks = np.flatnonzero(np.diff(where) > gap)
    starts = where[np.concatenate([[0], breaks + 1])]
    ends = where[np.concatenate([breaks, [len(where) - 1]])]
    return [slice(int(a), int(b) + 1) for a, b in zip(starts, ends, strict=True)]


def _curves(line: Line, surface: Surface, profile: NoiseProfile) -> list[tuple[Line, Line]]:
    """Fit a polynomial y(x) in the line's principal frame; return sampled points and unit normals.

    The argument is scaled to [-1, 1]; the degree is 5, or 2 for short lines. A line that is not a
    function y(x) is cut at its furthest point from the chord between its ends.
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
        normals = (
            -normals
        )  # normal = (-dy, dx) of the tangent, so that the sides are labelled consistently
    return [(points, normals)]


def _measure(
    curve: Line,
    sides: tuple[CrossSectionSide, CrossSectionSide],
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

    crests = world(curve, sides[0].z[:, 0])
    contours, feet, arcs_contour, arcs_foot = [], [], [], []
    for side in sides:
        points, height, arc = side.at(side.contour)
        contours.append(world(points, height)[ok])
        arcs_contour.append(arc[ok])
        points, height, arc = side.at(side.foot)
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
    """Return the vertical heights, metres, of points over the lines from starts to ends, (n, 3)."""
    span = ends - starts
    squared = np.maximum(np.sum(span[:, :2] ** 2, axis=1), 1e-12)
    share = np.sum((points - starts)[:, :2] * span[:, :2], axis=1) / squared
    return np.asarray(points[:, 2] - starts[:, 2] - share * span[:, 2])
