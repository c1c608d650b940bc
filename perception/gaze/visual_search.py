"""Visual search: detect all instances of known objects (garments, markers) in an image.

Each match between a scene's and a template's feature votes for a pose of the template in the image
(position, rotation, scale: D. Lowe, IJCV 2004, section 7.3). The densest cluster of votes is one
instance; its homography is estimated by MAGSAC++, its matches are removed, and the search repeats.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
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

#: Lowe's ratio of the nearest to the second nearest distance.
_RATIO = 0.85

#: Largest distance of votes in a cluster, fraction of the instance's size.
_CLUSTER_DISTANCE = 0.3

#: Largest difference of scale in a cluster, octaves.
_CLUSTER_SCALE_OCTAVES = 0.7

#: Largest difference of rotation in a cluster, radians.
_CLUSTER_TURN_RAD = np.radians(30.0)

#: Least number of votes of a cluster.
_MIN_VOTES = 4

#: Inlier tolerance of a homography, pixels of the reduced image; cloth is not planar.
_TOLERANCE_PX = 3.0

#: Intersection over union above which two detections are the same object.
_SAME_OBJECT_IOU = 0.3

#: Limit of the instances of a template.
_MAX_INSTANCES = 50

#: Limit of the votes that clusters are formed around.
_MAX_SEEDS = 400


@dataclass(frozen=True, eq=False)
class Instance:
    """One detected object in an image.

    Attributes:
        name: of its template.
        H: (3, 3) homography from the template's pixels to the image's.
        centre: (2,) position of the template's reference point, pixels.
        corners: (4, 2) of the template's box, clockwise, pixels; may be outside the image.
        turn: rotation, clockwise in the image, radians.
        scale: of the template at the centre.
        inliers: number of inlier matches.
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
        """Axis-aligned bounding box u0, v0, u1, v1 of the corners, pixels."""
        (u0, v0), (u1, v1) = self.corners.min(axis=0), self.corners.max(axis=0)
        return float(u0), float(v0), float(u1), float(v1)


def search(
    scene: View, templates: Sequence[Template], *, least: int = LEAST_INLIERS
) -> tuple[Instance, ...]:
    """Detect every instance of the templates in a view, sorted by inliers, most first.

    Args:
        scene: view reduced by about the factor of the templates. Small objects in a large image
            need a small factor and many features, see `view`.
        templates: several may share a name (views of the same object).
        least: least number of inliers of an instance.

    Returns:
        The instances; of two that overlap, the one with more inliers.

    Raises:
        InputError: no template, or `least` is below 4.
    """
    if not templates:
        raise InputError("visual search: no template; say what to look for")
    if least < _MIN_VOTES:
        raise InputError(f"visual search: {least} matches determine nothing, at least 4 do")
    found = [instance for thing in templates for instance in _instances(scene, thing, least)]
    found.sort(key=lambda instance: -instance.inliers)
    kept: list[Instance] = []
    for instance in found:
        if all(_overlap(instance.corners, other.corners) < _SAME_OBJECT_IOU for other in kept):
            kept.append(instance)
    return tuple(kept)


def _instances(scene: View, thing: Template, least: int) -> list[Instance]:
    # Match from scene to template: a feature of the template may occur in the scene several times.
    pairs = matches(scene.features, thing.features, ratio=_RATIO, mutual=False)
    votes = _votes(scene, thing, pairs)
    p, q = thing.features.points[pairs[:, 1]], scene.features.points[pairs[:, 0]]
    seeds = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), _MAX_SEEDS)).astype(int))
    near = _near(votes[seeds], votes, thing)
    untried = np.ones(len(seeds), dtype=bool)
    left = np.ones(len(pairs), dtype=bool)  # matches not yet assigned to an instance
    tolerance = _TOLERANCE_PX * scene.factor
    found: list[Instance] = []
    while len(found) < _MAX_INSTANCES:
        counts = np.where(untried & left[seeds], near[:, left].sum(axis=1), 0)
        if len(counts) == 0 or counts.max() < _MIN_VOTES:
            break
        peak = int(np.argmax(counts))
        untried[peak] = False
        cluster = near[peak] & left
        fitted = mapping(p[cluster], q[cluster], tolerance=tolerance, least=_MIN_VOTES)
        if fitted is None:
            continue
        agree = left & _agree(fitted[0], p, q, tolerance)
        # Refit with all inliers: votes are less precise than positions.
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
    """Return the pose (n, 4) that each match votes for: centre u, v, log2 scale, rotation."""
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
    """Return the mask (m, n) of votes (n, 4) close to the pose of each seed (m, 4)."""
    size = float(np.linalg.norm(thing.corners[2] - thing.corners[0])) / sqrt(2.0)
    apart = votes[None, :] - seeds[:, None]
    reach = _CLUSTER_DISTANCE * size * 2.0 ** seeds[:, 2]
    turned = np.abs((apart[..., 3] + np.pi) % (2.0 * np.pi) - np.pi)
    place = np.hypot(apart[..., 0], apart[..., 1])
    close = (place < reach[:, None]) & (turned < _CLUSTER_TURN_RAD)
    return np.asarray(close & (np.abs(apart[..., 2]) < _CLUSTER_SCALE_OCTAVES))


def _agree(H: Homography, p: Points, q: Points, tolerance: float) -> NDArray[np.bool_]:
    missed = np.linalg.norm(mapped(H, p) - q, axis=1)
    return np.asarray(missed < tolerance)  # False for NaN


def _instance(thing: Template, H: Homography, inliers: int) -> Instance | None:
    """Return the instance, or None if its box is not convex or not in front of the camera."""
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
    """Return the intersection over union of two convex quadrangles (4, 2)."""
    a32, b32 = a.astype(np.float32), b.astype(np.float32)
    shared, _ = cv2.intersectConvexConvex(a32, b32)
    union = cv2.contourArea(a32) + cv2.contourArea(b32) - shared
    return float(shared / union) if union > 0.0 else 0.0
