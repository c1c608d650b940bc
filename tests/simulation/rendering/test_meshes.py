"""Meshes: OBJ contents, accuracy of the facets, refused input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.rendering.meshes import (
    TexturedMesh,
    grid_triangles,
    height_field_mesh,
    rectangle_mesh,
    towel_mesh,
    vertex_normals,
)
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.simulation.rendering.textures import uniform

GREY = uniform((128, 128, 128))


def _parsed(obj: bytes) -> dict[str, list[list[str]]]:
    lines: dict[str, list[list[str]]] = {}
    for line in obj.decode().splitlines():
        key, *words = line.split(" ")
        lines.setdefault(key, []).append(words)
    return lines


@given(hnp.arrays(float, (4, 3), elements=st.floats(-9.8, 9.8)))
def test_obj_holds_vertices_texture_places_and_triangles(vertices: np.ndarray) -> None:
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [0.25, 1.0], [0.5, 0.125]])
    triangles = np.array([[0, 1, 2], [3, 2, 1]])
    lines = _parsed(TexturedMesh("m", vertices, triangles, uv, GREY).obj("m.mtl"))
    assert lines["mtllib"] == [["m.mtl"]]
    np.testing.assert_allclose(np.array(lines["v"], dtype=float), vertices, atol=0.51e-7)
    np.testing.assert_allclose(np.array(lines["vt"], dtype=float), uv, atol=1e-12)
    assert [[word.split("/") for word in face] for face in lines["f"]] == [
        [[str(i + 1)] * 3 for i in triangle] for triangle in triangles
    ]


def test_normals_of_a_bump_are_those_of_its_gradient() -> None:
    x, y = np.meshgrid(np.linspace(-0.02, 0.02, 81), np.linspace(-0.02, 0.02, 81))
    z = 0.5 * (40.0 * x * x + 20.0 * y * y)
    normals = vertex_normals(np.stack([x, y, z], -1).reshape(-1, 3), grid_triangles(81, 81))
    exact = np.stack([-40.0 * x, -20.0 * y, np.ones_like(x)], axis=-1)
    exact /= np.linalg.norm(exact, axis=-1, keepdims=True)
    inner = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(normals.reshape(81, 81, 3)[inner], exact[inner], atol=1e-4)


def test_triangles_of_a_grid_face_up() -> None:
    mesh = rectangle_mesh("r", (0.4, 0.2), GREY)
    np.testing.assert_allclose(mesh.normals, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.4, 0.2, 0.0])
    # The texture's left goes to -x, its bottom to -y.
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2] / [0.4, 0.2] + 0.5)


def test_towel_mesh_lies_on_the_towel_and_ends_at_its_rim() -> None:
    towel = Towel((Ridge((0.0, -1.1), 0.3, 0.02, 0.0125, 0.1),), side=0.2, yaw=0.2)
    mesh = towel_mesh(towel, "plain", spacing=0.002)
    p_W = mesh.vertices + mesh.X_WM[:3, 3]
    np.testing.assert_allclose(p_W[:, 2] - 0.70, towel.height(p_W[:, 0], p_W[:, 1]), atol=1e-12)
    middles = p_W[mesh.triangles].mean(axis=1)
    on = towel.edge_distance(middles[:, 0], middles[:, 1])
    assert on.min() > -0.002
    a, b = np.moveaxis(np.diff(p_W[mesh.triangles][..., :2], axis=1), 1, 0)
    areas = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    rim = 4.0 * 0.2 * 0.002
    assert 0.04 - rim < areas.sum() < 0.04 + rim
    assert len(np.unique(mesh.triangles)) == len(mesh.vertices)
    # Facets of a ridge as high and sharp as 134 1/m stay within spacing^2 / 8 of it, twice (x, y).
    sag = middles[:, 2] - 0.70 - towel.height(middles[:, 0], middles[:, 1])
    assert np.abs(sag[on > 0.004]).max() < 2 * 134 * 0.002**2 / 8


def test_texture_covers_the_whole_towel() -> None:
    towel = Towel((), side=0.3, yaw=0.4)
    mesh = towel_mesh(towel, "plain", spacing=0.01)
    assert mesh.uv.min() >= 0.0 and mesh.uv.max() <= 1.0
    height, width = mesh.texture.pixels.shape[:2]
    span = np.ptp(mesh.vertices[:, :2] / np.maximum(mesh.uv, 1e-9), axis=0)
    assert np.isfinite(span).all() and height == width


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("vertices", "triangles", "uv", "words"),
    [
        (SQUARE, [[0, 1, 4]], SQUARE[:, :2], "names vertex 4"),
        (SQUARE, [[0, 1, -1]], SQUARE[:, :2], "below 0"),
        (SQUARE, [[0, 1, 2]], SQUARE[:3, :2], "must be"),
        (SQUARE, np.zeros((0, 3), int), SQUARE[:, :2], "at least one"),
        (SQUARE * np.nan, [[0, 1, 2]], SQUARE[:, :2], "not finite"),
        (SQUARE * 12.0, [[0, 1, 2]], SQUARE[:, :2], "12.0 m"),
    ],
)
def test_bad_meshes_are_refused(vertices, triangles, uv, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words):
        TexturedMesh("m", vertices, np.array(triangles), uv, GREY)


def test_height_field_of_which_nothing_is_inside_is_refused() -> None:
    with pytest.raises(InputError, match="nothing"):
        height_field_mesh(
            "h",
            lambda x, y: 0.0 * x,
            GREY,
            centre=(0.0, 0.0),
            size=(0.1, 0.1),
            table_height=0.7,
            inside=lambda x, y: 0.0 * x - 1.0,
        )
