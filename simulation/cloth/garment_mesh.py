"""Render mesh of a cloth state: finer than the solver's nodes, with the cloth's thickness.

Nodes are some 6 mm apart; flat facets of that size would be visible. Positions between nodes are
interpolated by a cubic spline along both yarn directions. Two sheets, half the thickness to either
side and joined at the rim, show both faces of folded cloth.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates
from scipy.sparse import csr_matrix

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.rendering.meshes import TexturedMesh, grid_triangles, vertex_normals
from unwrinkle.simulation.rendering.textures import cloth as cloth_texture

#: Cells of the render mesh per cell of the solver's grid, along either direction.
FACTOR = 2

#: Sigma of the smoothing of a stepped outline, cells.
_OUTLINE_SIGMA_CELLS = 1.0

#: Layers of nodes extrapolated beyond an outline, for a smooth end of the spline.
_EXTRAPOLATED_LAYERS = 4


class ClothMesh:
    """Builder of textured meshes of one cloth's states; constant parts are computed once."""

    def __init__(
        self,
        rest: Array,
        triangles: NDArray[np.integer[Any]],
        thickness: float,
        *,
        texture: str = "terry",
        seed: int = 0,
        name: str = "garment",
        factor: int = FACTOR,
    ) -> None:
        """Compute the constant parts of the meshes.

        Args:
            rest: (n, 2) nodes in the cloth's plane, on a square grid, metres.
            triangles: (m, 3) node numbers, two triangles in each cell of cloth; unless all cells
                are cloth, the steps of the outline are rounded.
            thickness: of the cloth, metres.
            texture: kind of cloth, see `simulation.rendering.textures`.
            seed: of the texture.
            name: of the mesh.
            factor: render cells per cell of the grid, along either direction.

        Raises:
            InputError: the nodes are not on a square grid, or the texture is unknown.
        """
        rest = np.asarray(rest, dtype=float)
        low = rest.min(axis=0)
        spacing = _spacing(rest)
        places = (rest - low) / spacing
        self._index = np.rint(places).astype(int)
        if np.abs(places - self._index).max() > 0.05:
            raise InputError("cloth mesh: the nodes' rest positions are not on a square grid")
        nx, ny = (int(k) + 1 for k in self._index.max(axis=0))
        self._shape = (nx, ny)
        known = np.zeros((nx, ny), dtype=bool)
        known[self._index[:, 0], self._index[:, 1]] = True
        self._filling = _filling(known)
        fine = [np.linspace(0.0, k - 1.0, factor * (k - 1) + 1) for k in (nx, ny)]
        splines = [make_interp_spline(np.arange(k), np.eye(k), k=3) for k in (nx, ny)]
        self._across, self._along = (
            np.asarray(spline(x)) for spline, x in zip(splines, fine, strict=True)
        )
        grid = grid_triangles(len(fine[0]), len(fine[1]))
        u, v = np.meshgrid(*fine, indexing="ij")
        uv = np.column_stack([u.ravel(), v.ravel()])
        cells = _cells(self._shape, places[np.asarray(triangles)].mean(axis=1))
        inside = np.ones(len(grid), dtype=bool)
        if not cells.all():
            inside, smooth = _smooth_outline(cells, uv, grid, 0.75 / factor)
            moved = (smooth != uv).any(axis=1)
            uv = smooth
        else:
            moved = np.zeros(len(uv), dtype=bool)
        used, grid = np.unique(grid[inside], return_inverse=True)
        self._used = used
        sheet = grid.reshape(-1, 3)
        count = len(used)
        # Rows of the grid run along x, so its triangles are clockwise seen from above: flip them.
        sheet = sheet[:, ::-1]
        self._sheet = sheet
        self._triangles = np.concatenate([sheet, sheet[:, ::-1] + count, _rim(sheet, count)])
        size = (spacing * (nx - 1), spacing * (ny - 1))
        # Vertices moved off the fine grid have their own spline weights.
        self._moved = np.flatnonzero(moved[used])
        self._own_across, self._own_along = (
            np.asarray(spline(uv[used[self._moved], k])) for k, spline in enumerate(splines)
        )
        share = uv[used] / np.array([nx - 1.0, ny - 1.0])
        self._uv = np.concatenate([share, share])
        self._texture = cloth_texture(texture, size, seed=seed)
        self._half, self._name = 0.5 * thickness, name

    def mesh(self, vertices: NDArray[np.floating[Any]]) -> TexturedMesh:
        """Return the mesh of world node positions (n, 3), metres.

        Raises:
            InputError: wrong number of nodes, or a position is not finite.
        """
        upper, lower = self.faces(vertices)
        centre = np.eye(4)
        return TexturedMesh(
            name=self._name,
            vertices=np.concatenate([upper, lower]),
            triangles=self._triangles,
            uv=self._uv,
            texture=self._texture,
            X_WM=centre,
        )

    def faces(self, vertices: NDArray[np.floating[Any]]) -> tuple[Array, Array]:
        """Return the vertices (k, 3) of the upper and the lower face, metres.

        Args:
            vertices: (n, 3) world node positions, metres.

        Raises:
            InputError: wrong number of nodes, or a position is not finite.
        """
        vertices = np.asarray(vertices, dtype=float)
        if vertices.shape != (len(self._index), 3) or not np.isfinite(vertices).all():
            raise InputError(
                f"cloth mesh: positions {vertices.shape} must be ({len(self._index)}, 3), finite"
            )
        grid = np.zeros((*self._shape, 3))
        grid[self._index[:, 0], self._index[:, 1]] = vertices
        flat = grid.reshape(-1, 3)
        for targets, weights in self._filling:
            flat[targets] = weights @ flat
        fine = np.einsum("ai,ijk,bj->abk", self._across, grid, self._along, optimize=True)
        middle = fine.reshape(-1, 3)[self._used]
        middle[self._moved] = np.einsum(
            "ki,ijc,kj->kc", self._own_across, grid, self._own_along, optimize=True
        )
        offset = self._half * vertex_normals(middle, self._sheet)
        return middle + offset, middle - offset


def _spacing(rest: Array) -> float:
    """Return the distance of neighbouring nodes, metres."""
    steps = np.diff(np.unique(np.round(rest[:, 0], 6)))
    steps = steps[steps > 1e-5]
    if len(steps) == 0:
        raise InputError("cloth mesh: all nodes are in one line")
    return float(np.median(steps))


def _filling(known: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], Any]]:
    """Return the extrapolation of nodes beyond the outline: targets and sparse weights per layer.

    A node is extrapolated linearly from two known nodes in line with it, as the mean over such
    lines. Beyond the last layer nodes take the position of their nearest node, which has no effect
    on the rendered points.
    """
    layers: list[tuple[NDArray[np.intp], Any]] = []
    known = known.copy()
    size, (nx, ny) = known.size, known.shape
    flat = np.arange(size).reshape(nx, ny)
    around = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]
    for _ in range(_EXTRAPOLATED_LAYERS):
        rows, columns, weights = [], [], []
        missing = np.argwhere(~known)
        for i, j in missing:
            lines = []
            for a, b in around:
                far = (i + 2 * a, j + 2 * b)
                if 0 <= far[0] < nx and 0 <= far[1] < ny and known[far] and known[i + a, j + b]:
                    lines.append((flat[i + a, j + b], flat[far]))
            for near, beyond in lines:
                rows += [flat[i, j], flat[i, j]]
                columns += [near, beyond]
                weights += [2.0 / len(lines), -1.0 / len(lines)]
        if not rows:
            break
        targets, local = np.unique(rows, return_inverse=True)
        layers.append((targets, csr_matrix((weights, (local, columns)), (len(targets), size))))
        known.ravel()[targets] = True
    targets = flat[~known]
    if len(targets):
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        source = flat[nearest[0], nearest[1]][~known]
        ones = np.ones(len(targets))
        weights_all = csr_matrix((ones, (np.arange(len(targets)), source)), (len(targets), size))
        layers.append((targets, weights_all))
    return layers


def _cells(shape: tuple[int, int], centroids: Array) -> NDArray[np.bool_]:
    """Return the mask of cells (nx - 1, ny - 1) that contain triangle centroids (m, 2)."""
    cells = np.zeros((shape[0] - 1, shape[1] - 1), dtype=bool)
    i, j = np.floor(centroids).astype(int).T
    cells[i, j] = True
    return cells


def _smooth_outline(
    cells: NDArray[np.bool_], uv: Array, grid: NDArray[np.int64], reach: float
) -> tuple[NDArray[np.bool_], Array]:
    """Smooth the stepped outline of a mask of square cells.

    Args:
        cells: mask of the cloth's cells.
        uv: (k, 2) fine vertices in cells of the grid.
        grid: (m, 3) fine triangles.
        reach: limit of a vertex's displacement, cells.

    Returns:
        The mask (m,) of triangles that are cloth, and the vertices (k, 2), with those of the border
        moved to the level 1/2 of the blurred mask (exact for straight edges).
    """
    pad = 6
    blurred = gaussian_filter(np.pad(cells.astype(float), pad), _OUTLINE_SIGMA_CELLS)

    def level(places: Array) -> Array:
        return np.asarray(map_coordinates(blurred, places.T - 0.5 + pad, order=3)) - 0.5

    inside = level(uv[grid].mean(axis=1)) > 0.0
    border = np.unique(_border(grid[inside]))
    begin = uv[border]
    place = begin.copy()
    for _ in range(3):
        step = 1e-3
        slope = np.column_stack(
            [(level(place + d) - level(place - d)) / (2.0 * step) for d in step * np.eye(2)]
        )
        square = np.maximum((slope**2).sum(axis=1), 1e-3)
        place = place - slope * (level(place) / square)[:, None]
        place = begin + np.clip(place - begin, -reach, reach)
    moved = uv.copy()
    moved[border] = np.clip(place, 0.0, np.array(cells.shape, dtype=float))
    return inside, moved


def _border(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the directed edges (e, 2) that belong to one triangle only."""
    count = int(triangles.max()) + 1
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    forward = edges[:, 0] * count + edges[:, 1]
    backward = edges[:, 1] * count + edges[:, 0]
    return np.asarray(edges[~np.isin(forward, backward)])


def _rim(sheet: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return triangles between the borders of both sheets; lower vertices are offset by `count`."""
    a, b = _border(sheet).T
    return np.concatenate(
        [np.column_stack([a, a + count, b]), np.column_stack([b, a + count, b + count])]
    )
