"""Textured triangle meshes for the renderer, from height fields, rectangles or vertices.

A mesh is passed to the renderer as a Wavefront OBJ in memory, with its texture as PNG.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.rendering.synthetic_towel import Towel
from unwrinkle.simulation.rendering.textures import Texture, cloth

HeightField = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

#: Decimals of a coordinate in the OBJ: 0.1 micrometres.
_DECIMALS = 7

#: Largest coordinate, metres: one digit before the decimal point.
_MAX_COORDINATE_M = 9.9


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangle mesh with a texture; M is the mesh's frame.

    Attributes:
        name: unique within a scene.
        vertices: (n, 3) p_MV, metres.
        triangles: (m, 3) vertex indices, anticlockwise seen from outside; both sides are drawn.
        uv: (n, 2) texture coordinates: u from the left to the right edge, v from the BOTTOM to the
            top edge, both 0 to 1.
        texture: the texture.
        X_WM: (4, 4) pose in the world.

    Raises:
        InputError: shapes disagree, a number is not finite or beyond 9.9 m, or a vertex index is
            out of range.
    """

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    uv: NDArray[np.float64]
    texture: Texture
    X_WM: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        """Check the arrays and make them read-only."""
        vertices = np.array(self.vertices, dtype=np.float64)
        triangles = np.array(self.triangles, dtype=np.int64)
        uv = np.array(self.uv, dtype=np.float64)
        X_WM = np.array(self.X_WM, dtype=np.float64)
        label = f"mesh {self.name!r}"
        if vertices.ndim != 2 or vertices.shape[1] != 3 or uv.shape != (len(vertices), 2):
            raise InputError(
                f"{label}: vertices {vertices.shape} and uv {uv.shape} must be (n, 3) and (n, 2)"
            )
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
            raise InputError(f"{label}: triangles {triangles.shape} must be (m, 3), at least one")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError(
                f"{label}: a triangle names vertex {triangles.max()} (or one below 0) of "
                f"{len(vertices)}"
            )
        if not (np.isfinite(vertices).all() and np.isfinite(uv).all()):
            raise InputError(f"{label}: a vertex or its place in the texture is not finite")
        if np.abs(vertices).max() > _MAX_COORDINATE_M:
            raise InputError(
                f"{label}: a vertex lies {np.abs(vertices).max():.1f} m from the mesh's origin, at "
                f"most {_MAX_COORDINATE_M} m are possible; move the mesh by X_WM"
            )
        if X_WM.shape != (4, 4) or not np.isfinite(X_WM).all():
            raise InputError(f"{label}: X_WM {X_WM.shape} must be a finite (4, 4) pose")
        for array in (vertices, triangles, uv, X_WM):
            array.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "uv", uv)
        object.__setattr__(self, "X_WM", X_WM)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals (n, 3) of the vertices: area-weighted mean of the adjacent triangles."""
        return vertex_normals(self.vertices, self.triangles)

    def obj(self, material_file: str) -> bytes:
        """Return the mesh as an OBJ file that uses the material `cloth` of `material_file`."""
        number = self.triangles + 1
        width = len(str(len(self.vertices)))
        corner = _join([_digits(number, width)] * 3, "/")
        return b"".join(
            [
                f"mtllib {material_file}\nusemtl cloth\n".encode(),
                _lines("v", _decimals(self.vertices)),
                _lines("vt", _decimals(self.uv)),
                _lines("vn", _decimals(self.normals)),
                _lines("f", corner),
            ]
        )


def vertex_normals(
    vertices: NDArray[np.floating[Any]], triangles: NDArray[np.integer[Any]]
) -> NDArray[np.float64]:
    """Return the unit normals (n, 3) of vertices (n, 3): area-weighted over triangles (m, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    total = np.stack(
        [
            np.bincount(triangles.ravel(), np.repeat(face[:, k], 3), minlength=len(vertices))
            for k in range(3)
        ],
        axis=-1,
    )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def height_field_mesh(
    name: str,
    height: HeightField,
    texture: Texture,
    *,
    centre: tuple[float, float],
    size: tuple[float, float],
    table_height: float,
    inside: HeightField | None = None,
    spacing: float = 0.001,
) -> TexturedMesh:
    """Build the mesh of a surface z = height(x, y) above the table.

    The facets deviate from the surface by at most spacing^2 / 8 times its curvature: 17 micrometres
    for a ridge 21 mm high of sigma 12.5 mm at the default spacing.

    Args:
        name: of the mesh.
        height: function of world x, y (arrays) to the height above the table, metres.
        texture: of the rectangle, its top towards +y.
        centre, size: rectangle of the mesh in world x, y, metres.
        table_height: world z of the table, metres.
        inside: keep only triangles with a corner where this function is positive.
        spacing: largest distance of neighbouring vertices along x and y, metres.
    """
    nx, ny = (int(np.ceil(length / spacing)) + 1 for length in size)
    u, v = np.meshgrid(np.linspace(0.0, 1.0, nx), np.linspace(0.0, 1.0, ny))
    x, y = (u - 0.5) * size[0], (v - 0.5) * size[1]
    world = (x + centre[0], y + centre[1])
    triangles = grid_triangles(ny, nx)
    if inside is not None:
        on = np.asarray(inside(*world)).ravel() > 0.0
        triangles = triangles[on[triangles].any(axis=1)]
    X_WM = np.eye(4)
    X_WM[:3, 3] = (*centre, table_height)
    used, triangles = _used(triangles)
    return TexturedMesh(
        name=name,
        vertices=np.stack([x, y, height(*world)], axis=-1).reshape(-1, 3)[used],
        triangles=triangles,
        uv=np.stack([u, v], axis=-1).reshape(-1, 2)[used],
        texture=texture,
        X_WM=X_WM,
    )


def towel_mesh(
    towel: Towel,
    kind: str = "terry",
    *,
    name: str = "garment",
    seed: int | None = None,
    spacing: float = 0.001,
) -> TexturedMesh:
    """Build the mesh of a towel on its table.

    Args:
        towel: the towel.
        kind: texture: "terry", "print" or "plain".
        name: of the mesh.
        seed: of the texture; None for the towel's own.
        spacing: of the vertices, metres.

    Raises:
        InputError: the texture is unknown.
    """
    c, s = abs(np.cos(towel.yaw)), abs(np.sin(towel.yaw))
    across = float(towel.side * (c + s)) + 2.0 * towel.waviness + 2.0 * spacing
    seed = towel.seed if seed is None else seed
    return height_field_mesh(
        name,
        towel.height,
        cloth(kind, (across, across), seed=seed),
        centre=towel.centre,
        size=(across, across),
        table_height=towel.table_height,
        inside=towel.edge_distance,
        spacing=spacing,
    )


def rectangle_mesh(
    name: str,
    size: tuple[float, float],
    texture: Texture,
    X_WM: NDArray[np.floating[Any]] | None = None,
) -> TexturedMesh:
    """Build a centred rectangle in the x-y plane, facing +z, with the texture's top towards +y."""
    u, v = (values.ravel() for values in np.meshgrid([0.0, 1.0], [0.0, 1.0]))
    x, y = (u - 0.5) * size[0], (v - 0.5) * size[1]
    return TexturedMesh(
        name=name,
        vertices=np.column_stack([x, y, np.zeros(4)]),
        triangles=grid_triangles(2, 2),
        uv=np.column_stack([u, v]),
        texture=texture,
        X_WM=np.eye(4) if X_WM is None else np.asarray(X_WM, dtype=float),
    )


def grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the triangles (m, 3) of a row-major vertex grid, facing up if rows run along +y."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    d, c = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def _used(triangles: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of the used vertices, and the triangles renumbered to them."""
    if len(triangles) == 0:
        raise InputError("height field: nothing of it is inside; is it somewhere else?")
    used, renumbered = np.unique(triangles, return_inverse=True)
    return used, renumbered.reshape(-1, 3)


# Vectorised formatting: numbers as arrays of characters of fixed width, ten times faster than
# formatting them one by one.


def _digits(values: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """Return the zero-padded digits (n, k, width) of non-negative integers (n, k)."""
    characters = np.empty((*values.shape, width), dtype=np.uint8)
    rest = values.copy()
    for place in range(width - 1, -1, -1):
        rest, characters[..., place] = np.divmod(rest, 10)
    return characters + np.uint8(ord("0"))


def _decimals(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return values (n, k) of magnitude below 10 as signed decimals of fixed width."""
    steps = np.rint(values * 10.0**_DECIMALS).astype(np.int64)
    digits = _digits(np.abs(steps), _DECIMALS + 1)
    sign = np.where(steps < 0, ord("-"), ord("+")).astype(np.uint8)[..., None]
    point = np.full_like(sign, ord("."))
    return np.concatenate([sign, digits[..., :1], point, digits[..., 1:]], axis=-1)


def _join(parts: list[NDArray[np.uint8]], separator: str) -> NDArray[np.uint8]:
    between = np.full((*parts[0].shape[:-1], 1), ord(separator), dtype=np.uint8)
    joined = [parts[0]]
    for part in parts[1:]:
        joined += [between, part]
    return np.concatenate(joined, axis=-1)


def _lines(key: str, words: NDArray[np.uint8]) -> bytes:
    """Return one line per row: the key and the row's words (n, k, width), separated by spaces."""
    n, k, width = words.shape
    lines = np.full((n, len(key) + k * (width + 1) + 1), ord(" "), dtype=np.uint8)
    lines[:, : len(key)] = np.frombuffer(key.encode(), dtype=np.uint8)
    for i in range(k):
        start = len(key) + 1 + i * (width + 1)
        lines[:, start : start + width] = words[:, i]
    lines[:, -1] = ord("\n")
    return lines.tobytes()
