"""Where in a scene known things are: garments, markers, several of a kind told apart.

Each match of a scene's feature with a template's votes for a pose of the template in the image
(place, turn, scale: D. Lowe, IJCV 2004, section 7.3). The densest votes are one instance; MAGSAC++
finds its homography, its matches are taken away, and the rest votes again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models import InputError
from unwrinkle.perception.features import (
    LEAST_INLIERS,
    Homography,
    Points,
    Template,
    View,
    local_linear,
    mapped,
    mapping,
    matches,
)

_RATIO = 0.85
_NEAR_PLACE = 0.3  # of the instance's size
_NEAR_SCALE = 0.7  # octaves
_NEAR_TURN = np.radians(30.0)
_LEAST_VOTES = 4
_TOLERANCE = 3.0  # pixels of the reduced image; cloth is no plane
_SAME = 0.3  # overlap (intersection over union) above which two finds are one thing
_MOST_INSTANCES = 50
_MOST_SEEDS = 400  # matches that a cluster is looked for around


@dataclass(frozen=True, eq=False)
class Instance:
    """One thing found in an image.

    Attributes:
        name: of its template.
        H: (3, 3) from the template's pixels to the image's.
        centre: (2,) where the template's point that counts is, pixels.
        corners: (4, 2) of the template's box, clockwise, pixels; parts may be outside the image.
        turn: clockwise in the image, radians.
        scale: of the template, at the centre.
        inliers: matches that agree.
    """

    name: str
    H: Homography
    centre: Points
    corners: Points
    turn: float
    scale: float
    inliers: int

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Smallest upright box u0, v0, u1, v1 around the corners, pixels."""
        (u0, v0), (u1, v1) = self.corners.min(axis=0), self.corners.max(axis=0)
        return float(u0), float(v0), float(u1), float(v1)


def search(
    scene: View, templates: Sequence[Template], *, least: int = LEAST_INLIERS
) -> tuple[Instance, ...]:
    """Find every instance of the templates in a view, strongest (most inliers) first.

    Args:
        scene: to look in, reduced by about the factor of the templates. Small things in a large
            image want a small factor and many features, see `view`.
        templates: several may have one name (views of the same thing).
        least: matches that must agree on an instance.

    Returns:
        What was found; nothing is an empty tuple. Where two finds cover each other, the stronger.

    Raises:
        InputError: no template, or fewer than four matches are to suffice.
    """
    if not templates:
        raise InputError("visual search: no template; say what to look for")
    if least < _LEAST_VOTES:
        raise InputError(f"visual search: {least} matches determine nothing, at least 4 do")
    found = [instance for thing in templates for instance in _instances(scene, thing, least)]
    found.sort(key=lambda instance: -instance.inliers)
    kept: list[Instance] = []
    for instance in found:
        if all(_overlap(instance.corners, other.corners) < _SAME for other in kept):
            kept.append(instance)
    return tuple(kept)


def _instances(scene: View, thing: Template, least: int) -> list[Instance]:
    # From the scene to the template: a feature of the template may be in the scene many times.
    pairs = matches(scene.features, thing.features, ratio=_RATIO, mutual=False)
    votes = _votes(scene, thing, pairs)
    p, q = thing.features.points[pairs[:, 1]], scene.features.points[pairs[:, 0]]
    seeds = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), _MOST_SEEDS)).astype(int))
    near = _near(votes[seeds], votes, thing)
    untried = np.ones(len(seeds), dtype=bool)
    left = np.ones(len(pairs), dtype=bool)  # matches that no instance has taken
    tolerance = _TOLERANCE * scene.factor
    found: list[Instance] = []
    while len(found) < _MOST_INSTANCES:
        counts = np.where(untried & left[seeds], near[:, left].sum(axis=1), 0)
        if len(counts) == 0 or counts.max() < _LEAST_VOTES:
            break
        peak = int(np.argmax(counts))
        untried[peak] = False
        cluster = near[peak] & left
        fitted = mapping(p[cluster], q[cluster], tolerance=tolerance, least=_LEAST_VOTES)
        if fitted is None:
            continue
        agree = left & _agree(fitted[0], p, q, tolerance)
        # Once more with all that agree: votes spread more than positions do.
        fitted = mapping(p[agree], q[agree], tolerance=tolerance, least=least)
        if fitted is None:
            continue
        agree = left & _agree(fitted[0], p, q, tolerance)
        instance = _instance(thing, fitted[0], len(np.unique(pairs[agree, 1])))
        if instance is None or instance.inliers < least:
            continue
        left &= ~agree
        found.append(instance)
    return found


def _votes(scene: View, thing: Template, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Pose (n, 4) that each match votes for: centre u, v, octaves of scale, turn."""
    a, b = scene.features, thing.features
    turn = a.angles[pairs[:, 0]] - b.angles[pairs[:, 1]]
    scale = a.sizes[pairs[:, 0]] / b.sizes[pairs[:, 1]]
    arm = (thing.centre - b.points[pairs[:, 1]]) * scale[:, None]
    c, s = np.cos(turn), np.sin(turn)
    centre = a.points[pairs[:, 0]]
    centre = centre + np.stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]], 1)
    return np.column_stack([centre, np.log2(scale), turn])


def _near(
    seeds: NDArray[np.float64], votes: NDArray[np.float64], thing: Template
) -> NDArray[np.bool_]:
    """Which votes (n, 4) are for about the pose of which seed (m, 4), (m, n)."""
    size = float(np.linalg.norm(thing.corners[2] - thing.corners[0])) / sqrt(2.0)
    apart = votes[None, :] - seeds[:, None]
    reach = _NEAR_PLACE * size * 2.0 ** seeds[:, 2]
    turned = np.abs((apart[..., 3] + np.pi) % (2.0 * np.pi) - np.pi)
    place = np.hypot(apart[..., 0], apart[..., 1])
    close = (place < reach[:, None]) & (turned < _NEAR_TURN)
    return np.asarray(close & (np.abs(apart[..., 2]) < _NEAR_SCALE))


def _agree(H: Homography, p: Points, q: Points, tolerance: float) -> NDArray[np.bool_]:
    missed = np.linalg.norm(mapped(H, p) - q, axis=1)
    return np.asarray(missed < tolerance)  # NaN does not


def _instance(thing: Template, H: Homography, inliers: int) -> Instance | None:
    """Return the instance; None where its box is no convex one in front of the camera."""
    corners, centre = mapped(H, thing.corners), mapped(H, thing.centre)
    if not (np.isfinite(corners).all() and np.isfinite(centre).all()):
        return None
    if not cv2.isContourConvex(corners.astype(np.float32)):
        return None
    J = local_linear(H, thing.centre)
    return Instance(
        name=thing.name,
        H=H,
        centre=centre,
        corners=corners,
        turn=atan2(J[1, 0] - J[0, 1], J[0, 0] + J[1, 1]),
        scale=sqrt(float(np.linalg.det(J))),
        inliers=inliers,
    )


def _overlap(a: Points, b: Points) -> float:
    """Intersection over union of two convex quadrangles (4, 2)."""
    a32, b32 = a.astype(np.float32), b.astype(np.float32)
    shared, _ = cv2.intersectConvexConvex(a32, b32)
    union = cv2.contourArea(a32) + cv2.contourArea(b32) - shared
    return float(shared / union) if union > 0.0 else 0.0
