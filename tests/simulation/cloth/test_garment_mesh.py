"""Render mesh of a cloth: exact at nodes, smooth between, thickness; changing an item's mesh."""

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.cloth.garment_mesh import ClothMesh
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.simulation.rendering.meshes import TexturedMesh, rectangle_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import overhead_pose
from unwrinkle.simulation.rendering.textures import uniform
from unwrinkle.testing.table import TABLE

SPACING, THICKNESS = 0.01, 0.0025
CAMERA = Camera("c", 320, 240, 500.0, 500.0, 160.0, 120.0)


def sheet(mask: NDArray[np.bool_]) -> tuple[Array, NDArray[np.int64]]:
    """Rest positions and triangles of the square cells whose four nodes are in a mask (nx, ny)."""
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(mask))
    a, b = number[:-1, :-1], number[1:, :-1]
    d, c = number[:-1, 1:], number[1:, 1:]
    cells = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    a, b, c, d = a[cells], b[cells], c[cells], d[cells]
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return SPACING * np.argwhere(mask), triangles


def made(mask: NDArray[np.bool_], **options: int) -> tuple[ClothMesh, Array]:
    rest, triangles = sheet(mask)
    return ClothMesh(rest, triangles, THICKNESS, texture="plain", **options), rest


def area(mesh: TexturedMesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def outline_length(triangles: NDArray[np.int64], vertices: Array) -> float:
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    ends = vertices[pairs[count == 1]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def flat(rest: Array) -> Array:
    return np.column_stack([rest, np.full(len(rest), 0.70)])


def test_a_flat_cloth_has_two_faces_and_a_rim() -> None:
    cloth, rest = made(np.ones((12, 9), dtype=bool))
    mesh = cloth.mesh(flat(rest))
    size = np.array([0.11, 0.08])
    assert area(mesh) == pytest.approx(2.0 * size.prod() + 2.0 * size.sum() * THICKNESS, rel=1e-6)
    heights = np.unique(np.round(mesh.vertices[:, 2], 9))
    np.testing.assert_allclose(heights, [0.70 - 0.5 * THICKNESS, 0.70 + 0.5 * THICKNESS])
    upper, _ = cloth.faces(flat(rest))
    np.testing.assert_allclose(mesh.normals[: len(upper), 2].min(), 0.5, atol=0.5)
    assert (mesh.vertices[: len(upper), 2] > 0.70).all()  # triangles of the upper face look up
    corners = mesh.vertices[mesh.triangles]
    edges = np.concatenate(
        [mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]]
    )
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert (count == 2).all() and len(corners) == len(mesh.triangles)  # closed all around


def test_the_texture_lies_as_the_cloth_does() -> None:
    cloth, rest = made(np.ones((12, 9), dtype=bool))
    mesh = cloth.mesh(flat(rest))
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2] / np.array([0.11, 0.08]), atol=1e-9)
    rows, columns = mesh.texture.pixels.shape[:2]
    assert columns / rows == pytest.approx(11 / 8, rel=0.01)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_it_goes_through_the_nodes_and_is_smooth_between(factor: int) -> None:
    cloth, rest = made(np.ones((40, 12), dtype=bool), factor=factor)

    def wave(x: Array) -> Array:
        return np.asarray(0.70 + 0.010 * np.exp(-0.5 * ((x - 0.2) / 0.02) ** 2))

    upper, lower = cloth.faces(np.column_stack([rest, wave(rest[:, 0])]))
    middle = 0.5 * (upper + lower)
    np.testing.assert_allclose(middle[:, 2], wave(middle[:, 0]), atol=1.5e-4)
    node = np.abs(middle[:, 0] / SPACING - np.rint(middle[:, 0] / SPACING)) < 1e-6
    np.testing.assert_allclose(middle[node, 2], wave(middle[node, 0]), atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(upper - lower, axis=1), THICKNESS, rtol=1e-9)


def test_a_masked_outline_keeps_its_shape() -> None:
    shirt = outline("tshirt", 40)
    rest = shirt.spacing * np.argwhere(shirt.mask)
    _, triangles = sheet(shirt.mask)
    mesh = ClothMesh(rest, triangles, THICKNESS, texture="plain")
    own = 0.5 * shirt.spacing**2 * len(triangles)
    upper, _ = mesh.faces(flat(rest))
    whole = mesh.mesh(flat(rest))
    sheet_only = TexturedMesh(
        "upper",
        upper,
        whole.triangles[(whole.triangles < len(upper)).all(axis=1)],
        whole.uv[: len(upper)],
        whole.texture,
    )
    assert area(sheet_only) == pytest.approx(own, rel=0.02)
    # Its slanting edges have no steps: each of them would be as long as two sides of the triangle.
    edge = outline_length(sheet_only.triangles, upper)
    stepped = outline_length(triangles, flat(rest))
    slanting = 4.0 * (0.220 + 0.135)  # of sleeves and shoulders, about
    assert edge < stepped - 0.1 * slanting
    # What is filled in beyond the outline bends nothing inside: a slope stays a slope.
    slope = np.column_stack([rest, 0.70 + 0.3 * rest[:, 0] - 0.1 * rest[:, 1]])
    upper, lower = mesh.faces(slope)
    middle = 0.5 * (upper + lower)
    plane = 0.70 + 0.3 * middle[:, 0] - 0.1 * middle[:, 1]
    np.testing.assert_allclose(middle[:, 2], plane, atol=2e-5)


def test_bad_cloths_are_refused() -> None:
    rest, triangles = sheet(np.ones((6, 6), dtype=bool))
    with pytest.raises(InputError, match="square grid"):
        ClothMesh(rest * np.array([1.0, 0.7]), triangles, THICKNESS)
    with pytest.raises(InputError, match="one line"):
        ClothMesh(rest * np.array([0.0, 1.0]), triangles, THICKNESS)
    cloth = ClothMesh(rest, triangles, THICKNESS, texture="plain")
    with pytest.raises(InputError, match=r"must be \(36, 3\)"):
        cloth.mesh(np.zeros((35, 3)))
    with pytest.raises(InputError, match="finite"):
        cloth.mesh(np.full((36, 3), np.nan))


def test_a_reshaped_item_looks_as_if_built_anew() -> None:
    cloth, rest = made(np.ones((24, 24), dtype=bool))
    lying = flat(rest - 0.115) + np.array([0.0, -1.1, 0.00125])
    bent = lying + np.column_stack(
        [0.0 * rest, 0.02 * np.exp(-0.5 * ((rest[:, 0] - 0.1) / 0.02) ** 2)]
    )
    X_WC = overhead_pose(0.02, -1.12, 1.5)
    other = rectangle_mesh(
        "other", (0.05, 0.05), uniform((200, 40, 40)), overhead_pose(0.2, -1.1, 0.72)
    )
    changed = Renderer(TABLE, [cloth.mesh(lying), other])
    before = changed.colour(CAMERA, X_WC)
    changed.reshape("garment", cloth.mesh(bent))
    anew = Renderer(TABLE, [cloth.mesh(bent), other])
    np.testing.assert_array_equal(changed.depth(CAMERA, X_WC), anew.depth(CAMERA, X_WC))
    np.testing.assert_array_equal(changed.colour(CAMERA, X_WC), anew.colour(CAMERA, X_WC))
    assert (changed.colour(CAMERA, X_WC) != before).mean() > 0.05
    changed.reshape("garment", cloth.mesh(lying))
    np.testing.assert_array_equal(changed.colour(CAMERA, X_WC), before)
    with pytest.raises(InputError, match="no item 'shirt'"):
        changed.reshape("shirt", cloth.mesh(lying))


def test_both_faces_are_lit() -> None:
    """Folded over, the cloth shows its lower face: it must be as bright as the upper one."""
    cloth, rest = made(np.ones((24, 24), dtype=bool))
    lying = flat(rest - 0.115) + np.array([0.0, -1.1, 0.00125])
    over = lying * np.array([-1.0, 1.0, 1.0])
    X_WC = overhead_pose(0.0, -1.1, 1.5)
    means = []
    for vertices in (lying, over):
        picture = Renderer(TABLE, [cloth.mesh(vertices)]).colour(CAMERA, X_WC)
        means.append(picture[100:140, 140:180].mean())
    assert means[0] > 60.0 and means[1] == pytest.approx(means[0], rel=0.03)
