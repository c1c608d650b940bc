"""Reliable distances between convex shapes: each is the width of a gap between two parallel planes
that separate the shapes.

For any unit vector n, the gap between the extents of two convex sets along n is a lower bound of
their (signed) distance; for the right n it is equal. Drake's distance query uses a GJK that
overestimates the distance of boxes with parallel faces, in this cell by up to 140 mm (FCL issue
508), and may throw close to contact (Drake issue 21234). Its answer is therefore used only as a
candidate for n, beside the faces' normals. If no gap confirms it, the distance of the shapes' boxes
is computed as a bounded least-squares problem.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    Box,
    CalcObb,
    Capsule,
    Cylinder,
    GeometryId,
    HalfSpace,
    QueryObject,
    SceneGraphInspector,
    Sphere,
)
from scipy.optimize import lsq_linear

from unwrinkle.models.arrays import Array, Indices
from unwrinkle.models.errors import InputError

#: A queried distance is confirmed if the gap is less than this below it, m.
CONFIRMED = 1e-7


@dataclass(frozen=True, eq=False)
class Shapes:
    """Centrally symmetric outlines of N collision shapes: Minkowski sums of a box, a disk about its
    z axis and a ball.

    Exact for boxes, cylinders, capsules and spheres; other shapes are replaced by their bounding
    boxes.

    Attributes:
        ids: of the geometries in the scene graph.
        half: (N, 3) half widths of the box, m.
        disk: (N,) radius of the disk, m.
        ball: (N,) radius of the ball, m.
        R_GS: (N, 3, 3) outline's axes in the geometry's frame.
        p_GS: (N, 3) outline's centre in the geometry's frame, m.
    """

    ids: tuple[GeometryId, ...]
    half: Array
    disk: Array
    ball: Array
    R_GS: Array
    p_GS: Array

    @property
    def radius(self) -> Array:
        """Radii of the bounding spheres about the outlines' centres, (N,), m."""
        inner = np.hypot(np.hypot(self.half[:, 0], self.half[:, 1]) + self.disk, self.half[:, 2])
        return inner + self.ball

    def corners(self, i: int) -> Array:
        """Return the corners (8, 3) of the bounding box of shape `i` in the outline's axes, m."""
        extent = self.half[i] + self.disk[i] * np.array([1.0, 1.0, 0.0]) + self.ball[i]
        return box_corners(-extent, extent)


def outlines(inspector: SceneGraphInspector, ids: Sequence[GeometryId], names: str) -> Shapes:
    """Build the outlines of collision shapes.

    Args:
        inspector: of the scene graph.
        ids: of the shapes.
        names: their origin, for messages.

    Raises:
        InputError: a shape is unbounded.
    """
    rows = [_outline(inspector, i, names) for i in ids]
    return Shapes(
        tuple(ids), *(np.array(column, dtype=float) for column in zip(*rows, strict=True))
    )


def _outline(
    inspector: SceneGraphInspector, i: GeometryId, names: str
) -> tuple[Array, float, float, Array, Array]:
    """Return the fields of `Shapes` for one shape."""
    shape = inspector.GetShape(i)
    none, here, along = np.zeros(3), np.eye(3), np.array([0.0, 0.0, 0.5])
    if isinstance(shape, Box):
        return 0.5 * np.asarray(shape.size()), 0.0, 0.0, here, none
    if isinstance(shape, Cylinder):
        return along * shape.length(), shape.radius(), 0.0, here, none
    if isinstance(shape, Capsule):
        return along * shape.length(), 0.0, shape.radius(), here, none
    if isinstance(shape, Sphere):
        return none, 0.0, shape.radius(), here, none
    box = None if isinstance(shape, HalfSpace) else CalcObb(shape)
    if box is None:
        raise InputError(f"{names}: collision shape '{inspector.GetName(i)}' has no bounds")
    pose = box.pose()
    return np.asarray(box.half_width()), 0.0, 0.0, pose.rotation().matrix(), pose.translation()


def _extents(shapes: Shapes, which: Indices, R: Array, n: Array) -> Array:
    """Return the half extents (m, k), m, of m shapes with axes R (m, 3, 3) along directions n (m,
    k, 3).
    """
    local = np.abs(n @ R)
    flat = local @ shapes.half[which][:, :, None]
    rim = shapes.disk[which][:, None] * np.hypot(local[..., 0], local[..., 1])
    return flat[..., 0] + rim + shapes.ball[which][:, None]


def gaps(
    shapes: Shapes, first: Indices, second: Indices, R: tuple[Array, Array], p: Array, n: Array
) -> Array:
    """Bound the signed distances of m pairs of shapes from below.

    Args:
        shapes: outlines.
        first: (m,) shapes.
        second: (m,) shapes.
        R: (m, 3, 3) axes of the first and of the second shapes in the world.
        p: (m, 3) from the first shapes' centres to the second's, m.
        n: (m, k, 3) unit vectors; their sign does not matter.

    Returns:
        (m, k), m.
    """
    along = np.abs(n @ p[:, :, None])[..., 0]
    return along - _extents(shapes, first, R[0], n) - _extents(shapes, second, R[1], n)


def face_gaps(
    shapes: Shapes,
    first: Indices,
    second: Indices,
    R: tuple[Array, Array],
    p: Array,
    known: Array | None = None,
) -> Array:
    """Return the greatest gap (m,), m, along the axes of both shapes, the line of their centres and
    a known direction.

    Args as in `gaps`; `known` holds unit vectors (m, 3), or zeros where there is none.
    """
    length = np.linalg.norm(p, axis=1, keepdims=True)
    line = np.where(length > 1e-9, p / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])
    more = line if known is None else np.where(np.any(known, axis=1)[:, None], known, line)
    n = np.concatenate(
        [R[0].transpose(0, 2, 1), R[1].transpose(0, 2, 1), line[:, None], more[:, None]], axis=1
    )
    return gaps(shapes, first, second, R, p, n).max(axis=1)


def measure(
    query: QueryObject, shapes: Shapes, first: int, second: int, R: tuple[Array, Array], p: Array
) -> tuple[float, Array]:
    """Measure the signed distance of a pair of shapes in one configuration.

    Args:
        query: in that configuration.
        shapes: outlines.
        first: a shape.
        second: another one.
        R: (3, 3) axes of the first and of the second shape in the world.
        p: (3,) from the first shape's centre to the second's, m.

    Returns:
        A lower bound of the distance (equal to it for boxes), m, and the unit vector (3,) along
        which the shapes have that gap, or zeros.
    """
    pair = np.array([first]), np.array([second]), (R[0][None], R[1][None]), p[None]
    claimed, n = np.inf, np.zeros(3)
    try:
        answer = query.ComputeSignedDistancePairClosestPoints(shapes.ids[first], shapes.ids[second])
        claimed, n = float(answer.distance), np.asarray(answer.nhat_BA_W)
    except RuntimeError:
        pass  # FCL fails for some pairs in contact
    best = -np.inf
    # A zero direction would give a gap of zero.
    if np.all(np.isfinite(n)) and abs(np.linalg.norm(n) - 1.0) < 1e-6:
        best = float(gaps(shapes, *pair, n[None, None])[0, 0])
    else:
        n = np.zeros(3)
    if best < claimed - CONFIRMED:
        best = max(best, float(face_gaps(shapes, *pair)[0]))
    if best < claimed - CONFIRMED:
        direction = _box_direction(shapes, *pair)
        if direction is not None:
            gap = float(gaps(shapes, *pair, direction[None, None])[0, 0])
            if gap > best:
                best, n = gap, direction
    return best, n


def _box_direction(
    shapes: Shapes, first: Indices, second: Indices, R: tuple[Array, Array], p: Array
) -> Array | None:
    """Return the direction (3,) between the nearest points of two shapes' bounding boxes.

    None if the boxes intersect.
    """
    extents = [shapes.corners(int(i[0])).max(axis=0) for i in (first, second)]
    limit = np.concatenate(extents)
    matrix = np.hstack([R[0][0], -R[1][0]])
    points = lsq_linear(matrix, p[0], bounds=(-limit, limit), method="bvls", tol=1e-14).x
    between = p[0] - matrix @ points
    length = float(np.linalg.norm(between))
    return between / length if length > 1e-9 else None


def box_corners(low: Array, high: Array) -> Array:
    """Return the corners (8, 3) of the box from `low` to `high`."""
    grid = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.where(grid == 1, high, low)
