"""Ridge points, inflection contours, and the linking of ridge points into one line per wrinkle.

A ridge point is a positive extremum of -k_min (the convex curvature; z up) across the crest. Lines
of ridge points are cut at junctions of three branches and at domes and ruts. Pieces are joined
again only if they continue in the same direction, so that two crossing ridges stay two wrinkles.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from unwrinkle.models.arrays import Mask
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.surface import (
    CAP,
    DOME,
    FLAT,
    RIDGE,
    SADDLE_RIDGE,
    Surface,
    crest_direction,
    sample,
)

#: Polyline on the surface's grid, (n, 2) float (column, row), ordered along the ridge.
Line = NDArray[np.float64]

#: Length of a piece's end that its end tangent is fitted to, metres (at least one knot spacing).
TANGENT_LENGTH = 0.015

#: Pieces shorter than this fraction of the profile's `wrinkle_length` are dropped as noise.
PIECE_SHARE = 0.12

#: Width of the rim without ridge points, in knot spacings: the fit is poorly constrained there and
#: the cloth comes down to the table over some millimetres.
RIM_SPANS = 0.75

#: Lower bound of that width, metres.
RIM_LEAST = 0.008

#: Cosine of the bend (50 deg) within a gap's length above which a line is cut.
SHARP_BEND = 0.64

_RING = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


def ridge_points(surface: Surface, profile: NoiseProfile, *, domes: bool = False) -> Mask:
    """Mark positive extrema of -k_min across the crest, stronger than the profile's gate.

    Candidates are (majority-filtered) ridge and saddle-ridge cells off the rim; domes, ruts and the
    step down to the table therefore cut the lines. The strength is smoothed by a quarter of the
    knot spacing first, because a spline's second derivatives tend to have their extrema at knots.

    Args:
        surface: the fitted surface.
        profile: the sensor's profile.
        domes: also accept cells of class dome.
    """
    sigma = 0.25 * profile.knot_spacing / surface.resolution
    strength = cv2.GaussianBlur(-surface.k_min, (0, 0), max(sigma, 0.5))
    rim = max(RIM_SPANS * profile.knot_spacing, RIM_LEAST) / surface.resolution
    framed = np.pad(surface.inside.astype(np.uint8), 1)  # the map's border counts as a rim
    depth = cv2.distanceTransform(framed, cv2.DIST_L2, 3)[1:-1, 1:-1]
    candidate = (surface.classes == RIDGE) | (surface.classes == SADDLE_RIDGE)
    if domes:
        candidate |= surface.classes == DOME
    candidate &= (strength > profile.ridge_curvature) & (depth > rim)
    rows, columns = np.nonzero(candidate)
    points = np.stack([columns, rows], axis=1).astype(float)
    across = np.stack(
        crest_direction(
            surface.zxx[rows, columns], surface.zxy[rows, columns], surface.zyy[rows, columns]
        ),
        axis=1,
    )
    here = strength[rows, columns]
    left, right = sample(strength, points - across), sample(strength, points + across)
    best = (here >= left) & (here > right)
    ridge = np.zeros(candidate.shape, dtype=bool)
    ridge[rows[best], columns[best]] = True
    return ridge


def contour_points(surface: Surface) -> Mask:
    """Mark the inflection contours: cells where the Laplacian changes sign."""
    convex = (surface.zxx + surface.zyy) < 0.0
    shaped = surface.classes != FLAT
    contour = np.zeros(convex.shape, dtype=bool)
    contour[:, 1:] |= (convex[:, 1:] != convex[:, :-1]) & (shaped[:, 1:] | shaped[:, :-1])
    contour[1:, :] |= (convex[1:, :] != convex[:-1, :]) & (shaped[1:, :] | shaped[:-1, :])
    return contour & surface.inside


def link(ridge: Mask, surface: Surface, profile: NoiseProfile) -> list[Line]:
    """Link ridge points into lines, one per wrinkle.

    The points are thinned, cut at pixels with three branches, and traced into pieces. Pixels in the
    middle of a crossing that belong to neither ridge are dropped: short pieces between two pairs of
    other ends, and bends from one ridge into the other where another piece ends. Two ends are
    joined (Eq. 1: the nearest in the same ridge region first) if they are at most `link_gap` apart,
    both end tangents and the gap agree in direction within `linking_cosine`, and the gap lies in
    one ridge region.

    If the profile has a `stub_length`, short lines through domes are added where no other line is:
    the smoothing turns a fold that is hardly longer than wide into a dome.

    Returns:
        Lines of at least the profile's shortest ridge length, as ordered points (column, row).
    """
    lines = _linked(ridge, surface, profile)
    if profile.stub_length == 0.0:
        return lines
    own = profile.knot_spacing / surface.resolution
    stubs = _linked(ridge_points(surface, profile, domes=True), surface, profile)
    if lines:
        tree = cKDTree(np.concatenate(lines))
        stubs = [stub for stub in stubs if float(np.min(tree.query(stub)[0])) > own]
    longest = profile.wrinkle_length / surface.resolution
    return lines + [stub for stub in stubs if _extent(stub) < longest]


def _linked(ridge: Mask, surface: Surface, profile: NoiseProfile) -> list[Line]:
    shortest = PIECE_SHARE * profile.wrinkle_length / surface.resolution
    pieces = [line for line in _pieces(_thin(ridge)) if _extent(line) >= shortest]
    gap = profile.link_gap / surface.resolution
    pieces = _without_crossing_pieces(pieces, gap)
    ends = np.array([piece[side] for piece in pieces for side in (0, -1)]).reshape(-1, 2)
    pieces = [
        part
        for piece in pieces
        for part in _cut_at_kinks(piece, ends, gap, profile.linking_cosine)
        if _extent(part) >= shortest
    ]
    lines = _chains(pieces, _joints(pieces, surface, profile))
    least = profile.shortest_ridge / surface.resolution
    return [line for line in lines if _extent(line) >= least]


def _extent(line: Line) -> float:
    return float(np.hypot(*(line[-1] - line[0])))


def _thin(mask: Mask) -> Mask:
    """Thin lines to one pixel (Zhang and Suen 1984); visits the marked pixels only."""
    image = np.pad(mask, 1).astype(np.uint8)
    while True:
        removed = 0
        for step in (0, 1):
            rows, columns = np.nonzero(image)
            ring = [image[rows + dr, columns + dc] for dr, dc in _RING]
            count = np.sum(ring, axis=0)
            turns = sum((a == 0) & (b == 1) for a, b in itertools.pairwise([*ring, ring[0]]))
            north, east, south, west = ring[0], ring[2], ring[4], ring[6]
            if step == 0:
                open_side = (north * east * south == 0) & (east * south * west == 0)
            else:
                open_side = (north * east * west == 0) & (north * south * west == 0)
            drop = (count >= 2) & (count <= 6) & (turns == 1) & open_side
            image[rows[drop], columns[drop]] = 0
            removed += int(np.count_nonzero(drop))
        if removed == 0:
            return image[1:-1, 1:-1].astype(bool)


def _pieces(thin: Mask) -> list[Line]:
    """Cut thinned lines at pixels with three branches and return each piece as ordered points."""
    image = np.pad(thin, 1).astype(np.uint8)
    rows, columns = np.nonzero(image)
    ring = [image[rows + dr, columns + dc] for dr, dc in _RING]
    turns = sum((a == 0) & (b == 1) for a, b in itertools.pairwise([*ring, ring[0]]))
    branch = np.asarray(turns) >= 3
    for dr, dc in ((0, 0), *_RING):
        image[rows[branch] + dr, columns[branch] + dc] = 0
    rows, columns = np.nonzero(image)
    left = dict.fromkeys(zip(columns.tolist(), rows.tolist(), strict=True))
    pieces = []
    while left:
        seed, _ = left.popitem()
        ahead, behind = _walk(seed, left), _walk(seed, left)
        line = [*behind[::-1], seed, *ahead]
        pieces.append(np.array(line, dtype=float) - 1.0)
    return pieces


def _walk(start: tuple[int, int], left: dict[tuple[int, int], None]) -> list[tuple[int, int]]:
    """Trace neighbours from `start`, 4-neighbours first, removing them from `left`."""
    path, (x, y) = [], start
    while True:
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)):
            step = (x + dx, y + dy)
            if step in left:
                del left[step]
                path.append(step)
                x, y = step
                break
        else:
            return path


def _without_crossing_pieces(pieces: list[Line], gap: float) -> list[Line]:
    """Drop pieces inside a crossing: short ones with two other pieces' ends near each end."""
    if len(pieces) < 5:
        return pieces
    ends = np.array([piece[side] for piece in pieces for side in (0, -1)])
    near = cKDTree(ends).query_ball_point(ends, 0.5 * gap)

    def branches(end: int) -> int:
        return len({other // 2 for other in near[end]} - {end // 2})

    return [
        piece
        for i, piece in enumerate(pieces)
        if _extent(piece) > 2.0 * gap or min(branches(2 * i), branches(2 * i + 1)) < 2
    ]


def _cut_at_kinks(piece: Line, ends: Line, gap: float, least: float) -> list[Line]:
    """Cut a piece, and drop the bend, where it turns from one ridge of a crossing into the other.

    Criterion: the cosine between its directions over 0.8 gap lengths before and after the point is
    below `least` and another piece ends close by. A bend without such an end is a curved wrinkle,
    unless it is sharper than SHARP_BEND (a corner of two ridges).
    """
    span = round(0.8 * gap)
    if len(piece) < 3 * span:
        return [piece]
    back = piece[span:-span] - piece[: -2 * span]
    ahead = piece[2 * span :] - piece[span:-span]
    cosine = np.sum(back * ahead, axis=1) / (np.hypot(*back.T) * np.hypot(*ahead.T))
    kink = span + int(np.argmin(cosine))
    others = ends[np.min(cdist(ends, piece[[0, -1]]), axis=1) > 0.0]
    junction = bool(np.any(cdist(others, piece[[kink]]) <= 0.5 * gap))
    if float(cosine.min()) >= (least if junction else SHARP_BEND):
        return [piece]
    parts = piece[: kink - span // 3], piece[kink + span // 3 :]
    return [part for half in parts for part in _cut_at_kinks(half, ends, gap, least)]


def _outward_tangent(line: Line, length: float) -> NDArray[np.float64]:
    """Return the unit tangent out of the line at its first point, fitted to `length` cells."""
    near = line[np.hypot(*(line - line[0]).T) <= length]
    if len(near) < 3:
        near = line[:3]
    centred = near - near.mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    return np.asarray(direction if direction @ (near[0] - near[-1]) > 0.0 else -direction)


def _joints(
    pieces: list[Line], surface: Surface, profile: NoiseProfile
) -> dict[tuple[int, int], tuple[int, int]]:
    """Return the joined pairs of ends (piece, 0 or -1), as a map in both directions."""
    ends = [(i, side) for i in range(len(pieces)) for side in (0, -1)]
    if len(pieces) < 2:
        return {}
    length = max(TANGENT_LENGTH, profile.knot_spacing) / surface.resolution
    points = np.array([pieces[i][side] for i, side in ends])
    tangents = np.array(
        [_outward_tangent(pieces[i] if s == 0 else pieces[i][::-1], length) for i, s in ends]
    )
    gap = profile.link_gap / surface.resolution
    pairs = cKDTree(points).query_pairs(gap, output_type="ndarray")
    pairs = pairs[pairs[:, 0] // 2 != pairs[:, 1] // 2] if len(pairs) else pairs
    if not len(pairs):
        return {}
    a, b = pairs.T
    between = points[b] - points[a]
    distance = np.hypot(*between.T)
    # The direction of a gap of a few pixels is unreliable: allow two pixels of lateral offset.
    least = profile.linking_cosine
    slack = 2.0 + distance * np.sqrt(1.0 - least**2) / least
    aside = np.maximum(_offset(tangents[a], between), _offset(tangents[b], between))
    cosine = -np.sum(tangents[a] * tangents[b], axis=1)
    forward = np.minimum(_along(tangents[a], between), _along(tangents[b], -between))
    good = (cosine >= least) & (aside <= slack) & (forward >= -2.0)
    good &= _same_region(points[a], points[b], surface)
    cost = distance / gap + (1.0 - cosine) / max(1.0 - least, 1e-9)
    joints: dict[tuple[int, int], tuple[int, int]] = {}
    for k in sorted(np.flatnonzero(good).tolist(), key=lambda k: float(cost[k])):
        one, other = ends[a[k]], ends[b[k]]
        if one not in joints and other not in joints:
            joints[one], joints[other] = other, one
    return joints


def _along(direction: Line, vector: Line) -> NDArray[np.float64]:
    return np.asarray(np.sum(direction * vector, axis=1))


def _offset(direction: Line, vector: Line) -> NDArray[np.float64]:
    return np.abs(direction[:, 0] * vector[:, 1] - direction[:, 1] * vector[:, 0])


def _same_region(starts: Line, ends: Line, surface: Surface, share: float = 0.75) -> Mask:
    """Return whether at least `share` of each straight gap lies in the ridge region."""
    region = np.isin(surface.classes, (SADDLE_RIDGE, RIDGE, DOME, CAP)).astype(np.float32)
    steps = np.linspace(0.0, 1.0, 16)[None, :, None]
    path = starts[:, None, :] * (1.0 - steps) + ends[:, None, :] * steps
    return np.asarray(np.mean(sample(region, path), axis=1) >= share)


def _chains(pieces: list[Line], joints: dict[tuple[int, int], tuple[int, int]]) -> list[Line]:
    """Concatenate joined pieces in order; each end has at most one joint."""
    done: set[int] = set()
    free_first = sorted(range(len(pieces)), key=lambda i: ((i, 0) in joints) + ((i, -1) in joints))
    lines = []
    for first in free_first:
        if first in done:
            continue
        piece, entry = first, 0 if (first, 0) not in joints else -1
        parts = []
        while piece not in done:
            done.add(piece)
            parts.append(pieces[piece] if entry == 0 else pieces[piece][::-1])
            out = (piece, -1 if entry == 0 else 0)
            if out not in joints:
                break
            piece, entry = joints[out]
        lines.append(np.concatenate(parts))
    return lines
