"""Small triangle meshes for the browser: tubes, arrows, triads; world frame, m."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array

Faces = NDArray[np.int32]
Mesh = tuple[Array, Faces]

#: Number of sides of a tube.
_SIDES = 10
_AXIS_COLOURS = np.array([[0.90, 0.20, 0.15], [0.20, 0.65, 0.20], [0.15, 0.35, 0.90]])


def tube(points: NDArray[np.floating[Any]], radii: float | Array, *, capped: bool = True) -> Mesh:
    """Build a tube around a polyline.

    Args:
        points: (N, 3) m, N >= 2.
        radii: one radius, or (N,) radii, m.
        capped: whether both ends are closed by a disc.

    Returns:
        Vertices (V, 3) and triangles (F, 3), counter-clockwise seen from outside.

    Raises:
        ValueError: there are fewer than two points, or all coincide.
    """
    p = np.asarray(points, dtype=float)
    r = np.broadcast_to(np.asarray(radii, dtype=float), (len(p),))
    if len(p) < 2:
        raise ValueError("a tube needs at least two points")
    tangents = np.gradient(p, axis=0)
    along = np.linalg.norm(tangents, axis=1, keepdims=True)
    if not along.max() > 0.0:
        raise ValueError("a tube needs points in different places")
    tangents = np.where(
        along > 1e-12, tangents / np.maximum(along, 1e-12), tangents[along.argmax()]
    )
    ring = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    u = _perpendicular(tangents[0])
    normals = np.empty((len(p), 3))
    for i, t in enumerate(tangents):
        # The normal is carried along the line, so that the rings do not twist against each other.
        u = u - t * (u @ t)
        u = u / np.linalg.norm(u) if np.linalg.norm(u) > 1e-9 else _perpendicular(t)
        normals[i] = u
    others = np.cross(tangents, normals)
    circle = np.cos(ring)[:, None] * normals[:, None] + np.sin(ring)[:, None] * others[:, None]
    vertices = p[:, None] + r[:, None, None] * circle
    k = np.arange(_SIDES)
    after = (k + 1) % _SIDES
    a = _SIDES * np.arange(len(p) - 1)[:, None]
    b = a + _SIDES
    first = np.stack([a + k, a + after, b + after], axis=-1)
    second = np.stack([a + k, b + after, b + k], axis=-1)
    faces = [np.stack([first, second], axis=1).reshape(-1, 3)]
    flat = vertices.reshape(-1, 3)
    if capped:
        last = (len(p) - 1) * _SIDES
        flat = np.vstack([flat, p[0], p[-1]])
        faces.append(np.column_stack([np.full(_SIDES, len(flat) - 2), after, k]))
        faces.append(np.column_stack([np.full(_SIDES, len(flat) - 1), last + k, last + after]))
    return flat, np.concatenate(faces).astype(np.int32)


def arrow(
    tail: NDArray[np.floating[Any]],
    tip: NDArray[np.floating[Any]],
    radius: float,
    *,
    head_radius: float,
    head_length: float,
) -> Mesh:
    """Build an arrow from tail to tip, (3,) each, m; the head takes at most 60 % of its length.

    Raises:
        ValueError: tail and tip coincide.
    """
    a, b = np.asarray(tail, dtype=float), np.asarray(tip, dtype=float)
    length = float(np.linalg.norm(b - a))
    if not length > 0.0:
        raise ValueError("an arrow needs a length")
    neck = b - (b - a) * min(head_length / length, 0.6)
    shaft = tube(np.array([a, neck]), radius)
    head = tube(np.array([neck, b]), np.array([head_radius, 0.02 * head_radius]))
    return join([shaft, head])


def join(meshes: list[Mesh]) -> Mesh:
    """Join several meshes into one."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in meshes[:-1]])
    faces = [f + offset for (_, f), offset in zip(meshes, offsets, strict=True)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces).astype(np.int32)


def triad(X_WF: Array, length: float, radius: float) -> tuple[Array, Faces, Array]:
    """Build the axes of a frame: x red, y green, z blue.

    Args:
        X_WF: (4, 4) pose of the frame.
        length: length of each axis, m.
        radius: radius of each axis, m.

    Returns:
        Vertices (V, 3), triangles (F, 3) and colours (V, 3) in 0..1.
    """
    origin = X_WF[:3, 3]
    axes = [tube(np.array([origin, origin + length * X_WF[:3, k]]), radius) for k in range(3)]
    vertices, faces = join(axes)
    return vertices, faces, np.repeat(_AXIS_COLOURS, len(vertices) // 3, axis=0)


def _perpendicular(direction: Array) -> Array:
    other = np.eye(3)[int(np.abs(direction).argmin())]
    u = np.cross(direction, other)
    return np.asarray(u / np.linalg.norm(u))
