"""Pinch grasps across a ridge: position, direction, width and height.

Sun et al. 2016 (Robot vision architecture for autonomous clothes manipulation, section IV) grasp at
the highest wrinkledness, with the gripper set across the ridge by a triplet: the ridge point and
the two contour points (inflections) beside it. Here the triplet is taken from the cross-section of
the crest next to that point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.surface import Surface, sample
from unwrinkle.perception.wrinkles.wrinkledness import Wrinkledness

Vector = NDArray[np.float64]

#: Search distance of the crest from the proposed point, metres.
CREST_REACH = 0.015

#: Length along the ridge over which sections and curvatures are averaged, metres: the width of a
#: gripper's blade.
AVERAGED = 0.025

#: Least distance between two candidates of the wrinkledness, metres.
APART = 0.030

#: Least height of a ridge over its contours, metres; lower ones are cloth texture.
LEAST_RISE = 0.001

#: Sampling step of sections, metres.
_STEP_M = 0.0005

#: Iterations of finding the crest and the direction across it.
_ITERATIONS = 3

#: Limit of the candidates that are tried.
_MAX_CANDIDATES = 20


@dataclass(frozen=True, eq=False)
class GraspProposal:
    """Pinch grasp of a ridge. World frame W, metres.

    Attributes:
        p_WG: (3,) grasp point on the crest.
        across: (2,) horizontal unit vector across the ridge, from the first contour to the second;
            x > 0, or x = 0 and y > 0.
        contours: (2, 3) inflection points on either side of the crest.
        rise: height of the crest over the line between the contours.
        height: height of the crest above the table.
        score: wrinkledness score at the proposed point, nats/m; 0 if not from the wrinkledness.
    """

    p_WG: Vector
    across: Vector
    contours: Vector
    rise: float
    height: float
    score: float = 0.0

    def __post_init__(self) -> None:
        """Check and freeze the arrays.

        Raises:
            InputError: a value is not finite, or `across` is not a unit vector.
        """
        for name, shape in (("p_WG", (3,)), ("across", (2,)), ("contours", (2, 3))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError(f"grasp proposal: {name} must be {shape} finite numbers")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if abs(float(np.hypot(*self.across)) - 1.0) > 1e-6:
            raise InputError("grasp proposal: across must have length 1")

    @property
    def width(self) -> float:
        """Horizontal distance between the contours, metres."""
        return float(np.hypot(*(self.contours[1] - self.contours[0])[:2]))

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers and lists."""
        return {
            "p_WG": self.p_WG.tolist(),
            "across": self.across.tolist(),
            "contours": self.contours.tolist(),
            "width": self.width,
            "rise": self.rise,
            "height": self.height,
            "score": self.score,
        }


@dataclass(frozen=True)
class NoGrasp:
    """Why there is no grasp.

    Attributes:
        reason: one sentence: what, where, by how much.
    """

    reason: str


def propose_grasp(
    surface: Surface, wrinkledness: Wrinkledness, profile: NoiseProfile, table: float
) -> GraspProposal | NoGrasp:
    """Propose the grasp at the highest wrinkledness that has a triplet.

    Points without one (the cloth rises further, or ends before an inflection) are skipped.

    Args:
        surface: the garment's surface.
        wrinkledness: computed on that surface.
        profile: the sensor's profile.
        table: world z of the table, metres.

    Returns:
        The grasp, or the reason why the best point has none if no point has one.
    """
    first: NoGrasp | None = None
    for score, point in _candidates(wrinkledness):
        grasp = grasp_at(surface, point, profile, table, score=score)
        if isinstance(grasp, GraspProposal):
            return grasp
        first = first or grasp
    return first or NoGrasp("no convex spot on the garment: there is nothing to grasp from above")


def grasp_at(
    surface: Surface, point: Vector, profile: NoiseProfile, table: float, *, score: float = 0.0
) -> GraspProposal | NoGrasp:
    """Compute the grasp of the ridge next to a point.

    Args:
        surface: the garment's surface.
        point: (2,) world x, y, metres.
        profile: the sensor's profile.
        table: world z of the table, metres.
        score: stored in the proposal.
    """
    at = np.array(point, dtype=float)
    place = f"at ({at[0]:.3f}, {at[1]:.3f})"
    s = np.arange(-CREST_REACH, CREST_REACH + 0.5 * _STEP_M, _STEP_M)
    for _ in range(_ITERATIONS):
        across = across_direction(surface, at)
        z, inside = _section(surface, at, across, s)
        if not inside[len(s) // 2]:
            return NoGrasp(f"the point {place} is not on the garment's measured surface")
        at = at + s[_uphill(z, inside)] * across
        if np.hypot(*(at - point)) > CREST_REACH:
            return NoGrasp(f"no crest within {CREST_REACH} m {place}: the cloth rises further")
    across = across_direction(surface, at)
    crest = float(_section(surface, at, across, np.zeros(1))[0][0])
    left = _contour(surface, at, -across, profile.contour_reach)
    right = _contour(surface, at, across, profile.contour_reach)
    if left is None or right is None:
        return NoGrasp(
            f"the ridge {place} has no inflection within {profile.contour_reach} m on a side"
        )
    (a, za), (b, zb) = left, right
    rise = crest - (zb * a + za * b) / (a + b)
    if rise < LEAST_RISE:
        return NoGrasp(
            f"the ridge {place} stands {rise:.4f} m over its contours, at least {LEAST_RISE} m "
            "are needed"
        )
    contours = [[*(at - a * across), za + table], [*(at + b * across), zb + table]]
    return GraspProposal(
        np.array([*at, crest + table]), across, np.array(contours), rise, crest, score
    )


def across_direction(surface: Surface, point: Vector) -> Vector:
    """Return the unit direction (2,) of the most convex bending at a point.

    It is the eigenvector of the least eigenvalue of the height's Hessian (z up), averaged over
    AVERAGED.

    Args:
        surface: the garment's surface.
        point: (2,) world x, y, metres.
    """
    ticks = np.linspace(-0.5 * AVERAGED, 0.5 * AVERAGED, 11)
    disc = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= 0.5 * AVERAGED]
    cells = surface.cells(np.asarray(point, dtype=float) + disc)
    weight = np.exp(-8.0 * np.sum(disc**2, axis=1) / AVERAGED**2)  # a sigma of a quarter
    weight = weight * (sample(surface.inside.astype(np.float32), cells) >= 0.5)
    xx, xy, yy = (
        float(weight @ sample(image, cells)) for image in (surface.zxx, surface.zxy, surface.zyy)
    )
    direction: Vector = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))[1][:, 0]
    if direction[0] < 0.0 or (direction[0] == 0.0 and direction[1] < 0.0):
        direction = -direction
    return direction


def _candidates(wrinkledness: Wrinkledness) -> list[tuple[float, Vector]]:
    """Return (score, point) of the score's maxima, at least APART from each other, best first."""
    score = wrinkledness.score.copy()
    radius = APART / wrinkledness.resolution
    rows, columns = np.indices(score.shape)
    found: list[tuple[float, Vector]] = []
    while len(found) < _MAX_CANDIDATES:
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        best = float(score[row, column])
        if best <= 0.0:
            break
        point = np.asarray(wrinkledness.origin) + wrinkledness.resolution * np.array([column, row])
        found.append((best, point))
        score[np.hypot(rows - row, columns - column) < radius] = 0.0
    return found


def _section(
    surface: Surface, point: Vector, across: Vector, s: Vector
) -> tuple[Vector, NDArray[np.bool_]]:
    """Return heights (n,), m, and inside flags at point + s * across, averaged along the ridge."""
    along = np.array([-across[1], across[0]])
    ticks = np.linspace(-0.5 * AVERAGED, 0.5 * AVERAGED, 11)
    places = point + s[:, None, None] * across + ticks[None, :, None] * along
    cells = surface.cells(places)
    weight = np.exp(-8.0 * ticks**2 / AVERAGED**2) * (
        sample(surface.inside.astype(np.float32), cells) >= 0.5
    )
    total = weight.sum(axis=1)
    z = np.sum(weight * sample(surface.z, cells), axis=1) / np.maximum(total, 1e-9)
    inside: NDArray[np.bool_] = weight[:, len(ticks) // 2] > 0.0
    return z, inside


def _uphill(z: Vector, inside: NDArray[np.bool_]) -> int:
    """Return the index of the local maximum uphill from the middle of the section."""
    i = len(z) // 2
    while True:
        near = [k for k in (i - 1, i + 1) if 0 <= k < len(z) and inside[k] and z[k] > z[i]]
        if not near:
            return i
        i = max(near, key=lambda k: float(z[k]))


def _contour(
    surface: Surface, crest: Vector, outward: Vector, reach: float
) -> tuple[float, float] | None:
    """Return distance from the crest and height, metres, of the first inflection, or None."""
    s = np.arange(0.0, reach, _STEP_M)
    z, inside = _section(surface, crest, outward, s)
    slope = np.gradient(z, _STEP_M)
    bend = np.gradient(slope, _STEP_M)
    steep = np.minimum.accumulate(slope) < -0.02  # past the rounding of the crest itself
    found = np.flatnonzero((bend >= 0.0) & steep)
    if len(found) == 0 or not inside[: found[0] + 1].all():
        return None
    return float(s[found[0]]), float(z[found[0]])
