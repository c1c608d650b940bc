"""Tubes, arrows and triads."""

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.viewer.shapes import Mesh, arrow, join, triad, tube


def _volume(mesh: Mesh) -> float:
    """Signed volume: positive when every face looks outwards."""
    vertices, faces = mesh
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def _is_closed(faces: NDArray[np.int32]) -> bool:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    one = {(int(a), int(b)) for a, b in edges}
    return len(one) == len(edges) and all((b, a) in one for a, b in one)


@pytest.mark.parametrize("direction", [[1, 0, 0], [0, 0, 1], [0, 0, -1], [1, -2, 0.5]])
def test_straight_tube_is_a_closed_cylinder(direction: list[float]) -> None:
    end = np.array(direction, dtype=float)
    mesh = tube(np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3] + end]), 0.02)
    assert _is_closed(mesh[1])
    circle = 5.0 * np.sin(2.0 * np.pi / 10.0) * 0.02**2  # of a decagon
    assert _volume(mesh) == pytest.approx(circle * np.linalg.norm(end), rel=1e-6)


def test_bent_tube_keeps_its_radius() -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 60)
    points = np.column_stack([np.cos(t), np.sin(t), 0.3 * t])
    vertices, faces = tube(points, 0.05)
    rings = vertices[:-2].reshape(60, 10, 3)
    np.testing.assert_allclose(np.linalg.norm(rings - points[:, None], axis=2), 0.05, rtol=1e-9)
    assert _is_closed(faces)
    assert _volume((vertices, faces)) > 0.0


def test_tube_bears_repeated_points_but_not_only_them() -> None:
    vertices, _ = tube(np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]]), 0.1)
    assert np.all(np.isfinite(vertices))
    for points in (np.zeros((3, 3)), np.zeros((1, 3))):
        with pytest.raises(ValueError, match="a tube needs"):
            tube(points, 0.1)


@pytest.mark.parametrize("length", [0.01, 0.3])
def test_arrow_reaches_from_tail_to_tip(length: float) -> None:
    direction = np.array([0.6, 0.8, 0.0])
    tail = np.array([0.1, -1.0, 0.7])
    vertices, faces = arrow(
        tail, tail + length * direction, 0.004, head_radius=0.012, head_length=0.03
    )
    along = (vertices - tail) @ direction
    assert along.min() == pytest.approx(0.0, abs=1e-12)
    assert along.max() == pytest.approx(length)
    aside = np.linalg.norm(vertices - tail - np.outer(along, direction), axis=1)
    widest = along[aside > 0.0119]
    np.testing.assert_allclose(widest, length - min(0.03, 0.6 * length))
    assert _is_closed(faces)
    with pytest.raises(ValueError, match="length"):
        arrow(tail, tail, 0.004, head_radius=0.012, head_length=0.03)


def test_triad_shows_the_axes_of_its_frame() -> None:
    X = np.eye(4)
    X[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    X[:3, 3] = [1.0, 2.0, 3.0]
    vertices, faces, colours = triad(X, 0.1, 0.001)
    assert len(colours) == len(vertices)
    assert faces.max() == len(vertices) - 1
    for k in range(3):
        reach = (vertices - X[:3, 3]) @ X[:3, k]
        assert reach.max() == pytest.approx(0.1)
        assert colours[reach.argmax()].argmax() == k


def test_join_keeps_both() -> None:
    one = tube(np.array([[0.0, 0, 0], [1, 0, 0]]), 0.1)
    two = tube(np.array([[0.0, 5, 0], [2, 5, 0]]), 0.1)
    assert _volume(join([one, two])) == pytest.approx(_volume(one) + _volume(two))
