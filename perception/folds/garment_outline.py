"""The outline of a garment, and the place of its known flat outline under what is seen.

A folded garment shows less than its outline, and what it shows lies within the outline and follows
it where nothing is folded. Candidates for the turn come from the tangents' directions, those for
the place from a generalised Hough transform (D. H. Ballard, Pattern Recognition 1981); they are
refined by point-to-line alignment with the part of the outline that fits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.spatial import cKDTree

from unwrinkle.models.arrays import Mask
from unwrinkle.perception.folds.height_image import Points
from unwrinkle.perception.folds.nearest import nearest

#: Spacing of the points of an outline, metres, and the smoothing of the seen one.
_SPACING_M = 0.004
_SMOOTHING_M = 0.006

#: Points on the same outline: greatest distance, metres, and turn of the tangents, radians.
_ON_M = 0.005
_ON_TURN = math.radians(12.0)

#: Excess of the seen outline over the known one that costs nothing, metres, and the cost per metre
#: of excess and metre of outline.
_FREE_EXCESS_M = 0.003
_EXCESS_COST_M = 0.005

#: Turns, places of each, and placements in all that are tried; bins of the votes, radians and
#: metres.
_TURNS = 10
_PLACES = 4
_REFINED = 10
_TURN_BIN = math.radians(2.0)
_PLACE_BIN_M = 0.006

#: Placements whose corners are all within this of another's are the same, metres.
_SAME_M = 0.012

#: Placements that are kept, and how much less than the best one's share of the outline they fit.
_KEPT = 6
_SLACK = 0.12


@dataclass(frozen=True, eq=False)
class Placement:
    """Place of the known outline under the seen garment.

    Attributes:
        corners: (n, 2) of the known outline, metres, in the frame of the seen points.
        share: length of the seen outline on the known one less the cost of excess, over the known
            outline's length; at most 1.
    """

    corners: Points
    share: float


@dataclass(frozen=True, eq=False)
class _Curve:
    """A closed curve, anti-clockwise: evenly spaced points (n, 2) and its tangents' angles (n,)."""

    points: Points
    angles: Points

    @property
    def tangents(self) -> Points:
        return np.column_stack([np.cos(self.angles), np.sin(self.angles)])


def closed_outline(mask: Mask) -> Points:
    """Return the outer outline (n, 2) of the largest piece of a mask, (column, row)."""
    padded = np.pad(mask.astype(np.uint8), 1)
    outlines, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return np.zeros((0, 2))
    return max(outlines, key=cv2.contourArea)[:, 0].astype(float) - 1.0


def place_outline(seen: Points, known: Points) -> list[Placement]:
    """Find where a known outline lies, of which some parts may be folded away.

    Args:
        seen: (m, 2) closed outline of what is seen, metres.
        known: (n, 2) corners of the flat garment's outline, metres.

    Returns:
        The placements that fit best, best first; garments that lie with either side up.
    """
    target = _curve(seen, _SMOOTHING_M)
    found: list[Placement] = []
    for corners in _both_sides(known):
        model = _curve(corners, 0.0)
        candidates = [
            (votes, turn, shift)
            for turn in _turns(target, model)
            for votes, shift in _places(target, model, turn)
        ]
        candidates.sort(key=lambda each: -each[0])
        tried: list[Points] = []
        for _, turn, shift in candidates:
            place = _moved(corners, turn, shift)
            if len(tried) == _REFINED or any(_same(place, other) for other in tried):
                continue
            tried.append(place)
            turn, shift = _refined(target, model, turn, shift)
            share = _share(target, model, turn, shift)
            found.append(Placement(_moved(corners, turn, shift), share))
    found.sort(key=lambda placement: -placement.share)
    kept: list[Placement] = []
    for placement in found:
        if placement.share < found[0].share - _SLACK or len(kept) == _KEPT:
            break
        if not any(_same(placement.corners, other.corners) for other in kept):
            kept.append(placement)
    return kept


def _moved(corners: Points, turn: float, shift: Points) -> Points:
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + shift)


def _same(one: Points, other: Points) -> bool:
    """Whether two outlines cover the same cloth, whichever corner is called the first."""
    distance, _ = nearest(cKDTree(other), one)
    return float(distance.max()) < _SAME_M


def _both_sides(corners: Points) -> list[Points]:
    """Return the corners, anti-clockwise, and those of the garment turned over if it differs."""
    if _signed_area(corners) < 0.0:
        corners = corners[::-1]
    turned = (corners * np.array([-1.0, 1.0]))[::-1]
    if _is_symmetric(corners):
        return [corners]
    return [corners, turned]


def _is_symmetric(corners: Points) -> bool:
    """Whether the garment is its own mirror image, at some axis through its centroid."""
    return _symmetry(tuple(map(tuple, corners.tolist())))


@cache
def _symmetry(outline: tuple[tuple[float, float], ...]) -> bool:
    corners = np.array(outline)
    curve = _curve(corners, 0.0).points
    centre = curve.mean(axis=0)
    tree = cKDTree(curve - centre)
    for angle in np.linspace(0.0, math.pi, 180, endpoint=False):
        c, s = math.cos(2.0 * angle), math.sin(2.0 * angle)
        mirrored = (curve - centre) @ np.array([[c, s], [s, -c]])
        if float(np.quantile(nearest(tree, mirrored)[0], 0.95)) < 2.0 * _SPACING_M:
            return True
    return False


def _signed_area(points: Points) -> float:
    x, y = points.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _curve(points: Points, smoothing: float) -> _Curve:
    if _signed_area(points) < 0.0:
        points = points[::-1]
    closed = np.vstack([points, points[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    even = np.linspace(0.0, run[-1], max(16, round(run[-1] / _SPACING_M)), endpoint=False)
    points = np.column_stack([np.interp(even, run, closed[:, i]) for i in (0, 1)])
    if smoothing:
        points = gaussian_filter1d(points, smoothing / _SPACING_M, axis=0, mode="wrap")
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    return _Curve(points, np.arctan2(ahead[:, 1], ahead[:, 0]))


def _turns(target: _Curve, model: _Curve) -> list[float]:
    """Return the turns at which most of the tangents agree."""
    bins = round(2.0 * math.pi / _TURN_BIN)

    def histogram(curve: _Curve) -> Points:
        index = np.rint(curve.angles / _TURN_BIN).astype(int) % bins
        return gaussian_filter1d(np.bincount(index, minlength=bins).astype(float), 1.0, mode="wrap")

    spectrum = np.fft.rfft(histogram(target)) * np.conj(np.fft.rfft(histogram(model)))
    votes = np.fft.irfft(spectrum, bins)
    peaks = np.flatnonzero((votes >= np.roll(votes, 1)) & (votes > np.roll(votes, -1)))
    peaks = peaks[votes[peaks] > 0.3 * votes.max()]
    return [float(k) * _TURN_BIN for k in peaks[np.argsort(-votes[peaks])][:_TURNS]]


def _places(target: _Curve, model: _Curve, turn: float) -> list[tuple[float, Points]]:
    """Return the votes and shifts (2,) at which most points with the same tangents coincide."""
    c, s = math.cos(turn), math.sin(turn)
    rotated = model.points @ np.array([[c, s], [-s, c]])
    apart = np.abs(np.angle(np.exp(1j * (target.angles[:, None] - model.angles[None, :] - turn))))
    i, j = np.nonzero(apart < _ON_TURN)
    if not len(i):
        return []
    shifts = target.points[i] - rotated[j]
    low = shifts.min(axis=0) - 3.0 * _PLACE_BIN_M
    index = np.rint((shifts - low) / _PLACE_BIN_M).astype(int)
    shape = index.max(axis=0) + 4
    votes = np.bincount(index[:, 0] * shape[1] + index[:, 1], minlength=int(shape.prod()))
    votes = gaussian_filter(votes.reshape(shape).astype(float), 1.0)
    highest = cv2.dilate(votes, np.ones((7, 7), np.uint8))
    peaks = np.argwhere((votes >= highest) & (votes > 0.25 * votes.max()))
    order = np.argsort(-votes[tuple(peaks.T)])[:_PLACES]
    return [(float(votes[tuple(peak)]), low + _PLACE_BIN_M * peak) for peak in peaks[order]]


def _refined(target: _Curve, model: _Curve, turn: float, shift: Points) -> tuple[float, Points]:
    """Align the known outline with the part of the seen one that lies on it."""
    tree = cKDTree(model.points)
    normals = np.column_stack([-np.sin(model.angles), np.cos(model.angles)])
    for reach in (0.020, 0.012, 0.008, 0.006, 0.006):
        c, s = math.cos(turn), math.sin(turn)
        R = np.array([[c, -s], [s, c]])
        local = (target.points - shift) @ R
        distance, beside = nearest(tree, local)
        apart = np.angle(np.exp(1j * (target.angles - model.angles[beside] - turn)))
        use = (distance < reach) & (np.abs(apart) < 1.5 * _ON_TURN)
        if np.count_nonzero(use) < 12:
            break
        n, q, p = normals[beside[use]], model.points[beside[use]], local[use]
        off = np.sum((q - p) * n, axis=1)
        lever = p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]
        rows = np.column_stack([lever, n])
        # Directions that the outline does not fix stay.
        step = np.linalg.lstsq(
            np.vstack([rows, 1e-3 * math.sqrt(len(off)) * np.eye(3)]),
            np.concatenate([off, np.zeros(3)]),
            rcond=None,
        )[0]
        # The seen points move by the step in the model's frame: the model moves back.
        turn -= float(step[0])
        c, s = math.cos(turn), math.sin(turn)
        R_new = np.array([[c, -s], [s, c]])
        shift = shift - R_new @ step[1:]
    return turn, shift


def _share(target: _Curve, model: _Curve, turn: float, shift: Points) -> float:
    c, s = math.cos(turn), math.sin(turn)
    local = (target.points - shift) @ np.array([[c, -s], [s, c]])
    distance, beside = nearest(cKDTree(model.points), local)
    apart = np.abs(np.angle(np.exp(1j * (target.angles - model.angles[beside] - turn))))
    on = (distance < _ON_M) & (apart < _ON_TURN)
    normals = np.column_stack([np.sin(model.angles), -np.cos(model.angles)])  # outwards
    beyond = np.sum((local - model.points[beside]) * normals[beside], axis=1)
    excess = np.where(beyond > 0.0, np.maximum(distance - _FREE_EXCESS_M, 0.0), 0.0)
    return float((on - excess / _EXCESS_COST_M).sum()) / len(model.points)
