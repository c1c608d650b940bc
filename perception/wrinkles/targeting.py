"""Flattening target of a wrinkle: grasp points, directions and pull distance of both hands.

The hands grasp where the section perpendicular to the wrinkle leaves the garment on either side,
and pull along the section, away from the wrinkle. The section goes through the wrinkle's centre or
its highest part, and the pull removes the slack of the wrinkle or of everything on the section.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from unwrinkle.models.choices import PulledSlack, PullReading, SectionPlace
from unwrinkle.models.table import Table
from unwrinkle.perception.layer_mask import LayerMask
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.target import (
    STRETCH_LIMIT,
    STRETCH_MARGIN,
    FlatteningTarget,
    HandTarget,
    NoTarget,
)
from unwrinkle.perception.wrinkles.surface import Surface, sample
from unwrinkle.perception.wrinkles.wrinkle import PULL_COEFFICIENT, Wrinkle

Vectors = NDArray[np.float64]

#: Spacing of the points of the garment's contour, metres.
CONTOUR_SPACING = 0.002

#: Sigma of the contour's smoothing, metres (a window of 3 to 5 cm).
CONTOUR_SIGMA = 0.012

#: Width up to which notches and holes of the garment's mask are closed, metres.
CLOSED_GAP = 0.010

#: Distance of the grasp point inside the contour, along the section, metres.
GRASP_INSET = 0.005

#: Preferred least angle between section and contour, radians.
GOOD_CROSSING_ANGLE = math.radians(50.0)

#: Least angle between section and contour, radians; below it the pull runs along the rim.
LEAST_CROSSING_ANGLE = math.radians(25.0)

#: Length outside the contour that is checked for measurements, metres: a contour next to unseen
#: cells may be the limit of the view and not the garment's edge.
OUTSIDE_PROBE = 0.03

#: Least fraction of that length with measurements.
LEAST_SEEN = 0.2

#: What a gripper encloses: from the grasp point inwards, and to both sides of it, metres.
BLADE_REACH = 0.015
BLADE_HALF_WIDTH = 0.008

#: Room that the blades need beside the cloth between them, metres.
BLADE_ROOM = 0.008

#: Shifts of the sections that are tried in turn, fractions of the wrinkle's length.
SECTION_SHIFTS = (0.0, -0.1, 0.1, -0.2, 0.2, -0.3, 0.3, -0.4, 0.4)

#: Least distance of a section from the wrinkle's ends, fraction of its length.
END_SHARE = 0.1

#: Sigma of the smoothing of the crest height before its maximum is taken, metres.
CREST_SIGMA = 0.010


@dataclass(frozen=True, eq=False)
class GarmentContour:
    """Smoothed outer contour of a garment. World frame, metres.

    Attributes:
        points: (n, 2) closed polygon, anti-clockwise seen from above.
        normals: (n, 2) unit normals into the garment.
    """

    points: Vectors
    normals: Vectors

    def contains(self, point: Vectors) -> bool:
        """Return whether (x, y) lies inside."""
        polygon = self.points.astype(np.float32).reshape(-1, 1, 2)
        return cv2.pointPolygonTest(polygon, (float(point[0]), float(point[1])), False) > 0

    def leave(self, start: Vectors, direction: Vectors) -> tuple[float, Vectors] | None:
        """Return distance, metres, and inward normal at the ray's first crossing, or None."""
        along = (self.points - start) @ direction
        aside = (self.points - start) @ np.array([-direction[1], direction[0]])
        after = np.roll(np.arange(len(along)), -1)
        crossing = (aside > 0.0) != (aside[after] > 0.0)
        share = aside / np.where(crossing, aside - aside[after], 1.0)
        distance = along + share * (along[after] - along)
        hits = np.flatnonzero(crossing & (distance > 0.0))
        if len(hits) == 0:
            return None
        k = hits[np.argmin(distance[hits])]
        normal = (1.0 - share[k]) * self.normals[k] + share[k] * self.normals[after[k]]
        return float(distance[k]), normal / np.hypot(*normal)


def garment_contour(surface: Surface, near: Vectors | None = None) -> GarmentContour | None:
    """Return the smoothed outer contour of the garment, or of its piece around `near`.

    The outline of the mask is ragged by a few cells, which makes its normals unusable. It is
    resampled evenly and smoothed over CONTOUR_SIGMA, which rounds corners by a few millimetres.

    Args:
        surface: the garment's surface.
        near: world x, y; None for the largest piece.

    Returns:
        None if there is no garment there.
    """
    cells = max(1, round(CLOSED_GAP / surface.resolution))
    pad = cells + 1
    mask = np.pad(surface.garment.astype(np.uint8), pad)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (cells | 1, cells | 1))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disc)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outlines = [outline for outline in outlines if len(outline) > 8]
    if near is not None:
        column, row = (surface.cells(near) + pad).tolist()
        outlines = [o for o in outlines if cv2.pointPolygonTest(o, (column, row), False) >= 0]
    if not outlines:
        return None
    outline = max(outlines, key=cv2.contourArea)[:, 0, :].astype(float)
    points = surface.world(outline - pad)
    closed = np.vstack([points, points[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    even = np.arange(0.0, run[-1], CONTOUR_SPACING)
    points = np.column_stack([np.interp(even, run, closed[:, i]) for i in (0, 1)])
    points = gaussian_filter1d(points, CONTOUR_SIGMA / CONTOUR_SPACING, axis=0, mode="wrap")
    x, y = points.T
    if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0:
        points = points[::-1]
    tangents = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    normals /= np.maximum(np.hypot(*normals.T), 1e-12)[:, None]
    return GarmentContour(points, normals)


def flattening_target(
    range_map: RangeMap,
    surface: Surface,
    wrinkle: Wrinkle,
    *,
    table: Table,
    mode: str = PullReading.FOOT,
    section: str = SectionPlace.CENTRE,
    pull: str = PulledSlack.WRINKLE,
    opening: float = math.inf,
    layers: LayerMask | None = None,
) -> FlatteningTarget | NoTarget:
    """Compute the flattening target of a wrinkle, or the reason why there is none.

    The section through the wrinkle's centre (or highest part) is tried first, then sections shifted
    along the wrinkle by up to 40 % of its length to each side; then all again with the smaller
    limit of the angle between section and contour. Each hand pulls the wrinkle's Eq. 5 distance (or
    Eq. 5 of the whole section), limited so that the grippers end at most STRETCH_LIMIT x geodesic
    distance apart.

    Args:
        range_map: the range map of the surface; its valid mask shows what the sensor measured.
        surface: the garment's surface.
        wrinkle: the wrinkle to flatten.
        table: the working table; grasp points stay on it.
        mode: reading of Eq. 5, see `PullReading`.
        section: where along the wrinkle the section lies, see `SectionPlace`.
        pull: slack to remove, see `PulledSlack`; that of the section is counted from grasp point to
            grasp point.
        opening: of the grippers' blades, metres; what is too high for it is not grasped.
        layers: where cloth lies on other cloth, which is not grasped.

    Returns:
        The target; or the reason of the attempt that came nearest to one.

    Raises:
        InputError: unknown mode, section or pull.
    """
    reading = PullReading(mode)
    pulled = PulledSlack(pull)
    middle = section_place(wrinkle, section)
    contour = garment_contour(surface, wrinkle.centre)
    if contour is None:
        x, y = wrinkle.centre
        return NoTarget(f"the wrinkle's centre ({x:.3f}, {y:.3f}) lies outside the garment's mask")
    grasps = _GraspRules(range_map, surface, contour, table, opening, layers)
    nearest = _Problem(math.inf, "")
    shares = [middle + shift for shift in SECTION_SHIFTS]
    shares = [share for share in shares if abs(share - 0.5) < 0.5 - END_SHARE + 1e-6]
    for least in (GOOD_CROSSING_ANGLE, LEAST_CROSSING_ANGLE):
        for share in shares:
            start = section_start(wrinkle, share)
            target = _section_target(grasps, wrinkle, start, reading, pulled, least)
            if isinstance(target, FlatteningTarget):
                return target
            # An attempt of the second round is the same with a smaller limit.
            if least == LEAST_CROSSING_ANGLE and target.lack < nearest.lack:
                nearest = target
    return NoTarget(nearest.reason)


def section_place(wrinkle: Wrinkle, section: str) -> float:
    """Return the place of the section along a wrinkle, as a fraction of its length.

    Args:
        wrinkle: the wrinkle.
        section: see `SectionPlace`. The highest part is the maximum of the crest height, smoothed
            over CREST_SIGMA, at least END_SHARE from the ends.

    Raises:
        InputError: an unknown section.
    """
    if SectionPlace(section) is SectionPlace.CENTRE:
        return 0.5
    run = _run(wrinkle)
    spacing = float(np.median(np.diff(run)))
    smooth = gaussian_filter1d(
        wrinkle.curve[:, 2], CREST_SIGMA / max(spacing, 1e-6), mode="nearest"
    )
    inner = np.abs(run / run[-1] - 0.5) <= 0.5 - END_SHARE
    return float(run[np.argmax(np.where(inner, smooth, -np.inf))] / run[-1])


def section_start(wrinkle: Wrinkle, share: float) -> Vectors:
    """Return the point (3,) of the ridge at a fraction of its length; at 0.5 the centre."""
    run = _run(wrinkle)
    start = np.array([np.interp(share * run[-1], run, wrinkle.curve[:, i]) for i in range(3)])
    if share == 0.5:
        start[:2] = wrinkle.centre
    return start


def _run(wrinkle: Wrinkle) -> Vectors:
    """Return the horizontal arc length (n,), metres, along a wrinkle's curve."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wrinkle.curve[:, :2], axis=0).T))])


@dataclass(frozen=True)
class _Problem:
    """Why a grasp or a section cannot be used, and how much it lacks: 0 nothing, 1 a lot."""

    lack: float
    reason: str


@dataclass(frozen=True, eq=False)
class _GraspRules:
    """What a grasp point is judged by."""

    range_map: RangeMap
    surface: Surface
    contour: GarmentContour
    table: Table
    opening: float
    layers: LayerMask | None


def _section_target(
    grasps: _GraspRules,
    wrinkle: Wrinkle,
    start: Vectors,
    reading: PullReading,
    pulled: PulledSlack,
    least_angle: float,
) -> FlatteningTarget | _Problem:
    contour, surface = grasps.contour, grasps.surface
    ends: list[tuple[Vectors, Vectors, Vectors]] = []
    problems: list[_Problem] = []
    for sign in (-1.0, 1.0):
        outward = sign * wrinkle.normal
        crossing = contour.leave(start[:2], outward)
        if crossing is None or not contour.contains(start[:2]):
            return _Problem(
                1.0, "the section across the wrinkle starts outside the garment's contour"
            )
        distance, inward = crossing
        edge = start[:2] + distance * outward
        grasp = start[:2] + max(distance - GRASP_INSET, 0.0) * outward
        problem = _problem(grasps, edge, grasp, inward, outward, least_angle)
        if problem is not None:
            problems.append(problem)
        ends.append((grasp, inward, outward))
    if problems:
        worst = max(problems, key=lambda each: each.lack)
        return _Problem(sum(each.lack for each in problems), worst.reason)
    geodesic = section_length(surface, ends[0][0], ends[1][0])
    # Both hands move apart along the section: apart + 2 d <= limit x geodesic - margin.
    apart = float(np.hypot(*(ends[1][0] - ends[0][0])))
    most = max(0.5 * (STRETCH_LIMIT * geodesic - apart - STRETCH_MARGIN), 0.0)
    slack = PULL_COEFFICIENT * max(geodesic - apart, 0.0)
    asked = slack if pulled is PulledSlack.SECTION else wrinkle.pull_distance(reading)
    hands = [
        HandTarget(
            p_WG=np.array([*grasp, grasps.range_map.table_height]),
            grasp_direction=inward,
            pull_direction=outward,
            pull_distance=min(asked, most),
        )
        for grasp, inward, outward in ends
    ]
    return FlatteningTarget(
        hands=(hands[0], hands[1]),
        p_WC=start,
        wrinkle_direction=wrinkle.direction,
        geodesic_distance=geodesic,
        mode=reading,
    )


def section_length(surface: Surface, start: Vectors, end: Vectors) -> float:
    """Return the arc length of the surface's section between two world points (x, y), metres.

    It is an upper bound of the geodesic distance, and equal to it on a cylinder whose axis is
    perpendicular to the section.
    """
    span = float(np.hypot(*(end - start)))
    count = max(2, round(2.0 * span / surface.resolution) + 1)
    steps = np.linspace(0.0, 1.0, count)[:, None]
    points = surface.cells(start * (1.0 - steps) + end * steps)
    rise = np.diff(sample(surface.z, points).astype(float))
    return float(np.sum(np.hypot(rise, span / (count - 1))))


def _problem(
    grasps: _GraspRules,
    edge: Vectors,
    grasp: Vectors,
    inward: Vectors,
    outward: Vectors,
    least_angle: float,
) -> _Problem | None:
    """Return the reason why a grasp point is unusable, or None."""
    place = f"at ({edge[0]:.3f}, {edge[1]:.3f})"
    overhang = grasps.table.overhang(grasp)
    if overhang > 0.0:
        return _Problem(
            min(overhang / 0.1, 1.0),
            f"the garment reaches over the table's edge {place} by {overhang:.3f} m; "
            "move or turn the garment",
        )
    seen = _seen_outside(grasps.range_map, edge, outward)
    if seen < LEAST_SEEN:
        return _Problem(
            1.0 - seen / LEAST_SEEN,
            f"what lies outside the garment's contour {place} was not seen (the image's border, or "
            f"the shadow of a fold): only {seen:.0%} of {OUTSIDE_PROBE} m; move the camera or the "
            "garment",
        )
    angle = math.asin(min(max(float(-inward @ outward), -1.0), 1.0))
    if angle < least_angle:
        return _Problem(
            1.0 - max(angle, 0.0) / least_angle,
            f"the pull would run along the garment's edge {place}: {math.degrees(angle):.0f} deg "
            f"to it, at least {math.degrees(least_angle):.0f} deg are needed",
        )
    if not (grasps.contour.contains(grasp) and np.hypot(*(edge - grasp)) > 0.5 * GRASP_INSET):
        return _Problem(
            1.0,
            f"the wrinkle lies at the garment's rim {place}: there is no cloth to grasp beside it",
        )
    enclosed = _enclosed(edge, outward)
    height = float(sample(grasps.surface.z, grasps.surface.cells(enclosed)).max())
    most = grasps.opening - BLADE_ROOM
    if height > most:
        return _Problem(
            min(height / most - 1.0, 1.0),
            f"the cloth stands {1e3 * height:.0f} mm high {place}, and the gripper closes over at "
            f"most {1e3 * most:.0f} mm; open the stack or turn the garment",
        )
    if grasps.layers is not None and grasps.layers.at(enclosed).mean() > 0.3:
        return _Problem(
            0.5,
            f"cloth lies on other cloth {place}, and the gripper would take both; open the flap",
        )
    return None


def _enclosed(edge: Vectors, outward: Vectors) -> Vectors:
    """Return points (n, 2) of the cloth between the blades, world, metres."""
    inwards = np.linspace(0.0, GRASP_INSET + BLADE_REACH, 9)[:, None, None] * -outward
    aside = np.array([-outward[1], outward[0]])
    across = np.linspace(-BLADE_HALF_WIDTH, BLADE_HALF_WIDTH, 5)[None, :, None] * aside
    return np.asarray(edge + inwards + across).reshape(-1, 2)


def _seen_outside(range_map: RangeMap, edge: Vectors, outward: Vectors) -> float:
    """Return the fraction of OUTSIDE_PROBE outside the contour where the sensor measured."""
    steps = np.linspace(0.2, 1.0, 16)[:, None] * OUTSIDE_PROBE
    cells = np.rint(range_map.cell_from_world(edge + steps * outward)).astype(int)
    ny, nx = range_map.shape
    within = (cells[:, 0] >= 0) & (cells[:, 0] < nx) & (cells[:, 1] >= 0) & (cells[:, 1] < ny)
    column, row = cells[within].T
    return float(np.count_nonzero(range_map.valid[row, column])) / len(steps)
