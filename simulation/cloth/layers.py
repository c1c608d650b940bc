"""Layers of a simulated cloth, seen from above: how many, and which material is on top."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unwrinkle.models.compiled import njit
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.state import ClothState

#: Largest number of layers over a cell that is counted.
_MOST_LAYERS = 16

#: Two hits nearer than this are one layer that was hit on a triangle's side, m.
_SAME_M = 1e-6


@dataclass(frozen=True, eq=False)
class LayerMap:
    """Layers of a cloth on a grid. Column j lies at x = origin[0] + j * resolution.

    Attributes:
        layers: (ny, nx) number of layers over each cell.
        height: (ny, nx) of the uppermost layer above the flat cloth, m; NaN without cloth.
        material: (ny, nx, 2) place of the uppermost layer in the garment's plane, m.
        face_up: (ny, nx) whether it shows the side that was up when the garment was flat.
        origin: world x, y of the centre of cell [0, 0], m.
        resolution: side of a cell, m.
    """

    layers: NDArray[np.intp]
    height: NDArray[np.float64]
    material: NDArray[np.float64]
    face_up: NDArray[np.bool_]
    origin: NDArray[np.float64]
    resolution: float

    def folded(self, opening: float = 0.005) -> NDArray[np.bool_]:
        """Return the cells (ny, nx) where layers lie on each other, less overhangs of wrinkles.

        Args:
            opening: radius of the disc that must fit into a region of two layers, m.
        """
        radius = max(1, round(opening / self.resolution))
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        disc = x * x + y * y <= radius * radius
        return np.asarray(ndimage.binary_opening(self.layers >= 2, disc))

    def borders(self, apart: float = 0.015, step: float = 0.0015) -> NDArray[np.bool_]:
        """Return the cells (ny, nx) on the upper side of a border between layers.

        Args:
            apart: distance in the material from which neighbouring cells are other cloth, m.
            step: least height over the neighbouring cell, m.
        """
        found = np.zeros(self.layers.shape, dtype=bool)
        cloth = self.layers > 0
        for shift in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
            other = np.roll(self.material, shift, axis=(0, 1))
            lower = np.roll(self.height, shift, axis=(0, 1))
            far = np.hypot(*np.moveaxis(self.material - other, 2, 0)) > apart
            with np.errstate(invalid="ignore"):
                found |= (
                    cloth & np.roll(cloth, shift, axis=(0, 1)) & far & (self.height - lower > step)
                )
        return found


def layer_map(cloth: Cloth, state: ClothState, resolution: float = 0.002) -> LayerMap:
    """Count the layers of a cloth over each cell of a grid.

    Raises:
        InputError: the resolution is out of range.
    """
    if not (np.isfinite(resolution) and 1e-4 <= resolution <= 0.1):
        raise InputError(f"layer map: resolution {resolution:g} m; give 0.0001 to 0.1")
    vertices = cloth.vertices(state)
    margin = 0.02
    origin = np.floor((vertices[:, :2].min(axis=0) - margin) / resolution) * resolution
    nx, ny = np.ceil((vertices[:, :2].max(axis=0) + margin - origin) / resolution).astype(int) + 1
    local = vertices - np.array([*origin, cloth.flat_height])
    local[:, :2] /= resolution
    hits = np.full((ny, nx, _MOST_LAYERS), -np.inf)
    layers = np.zeros((ny, nx), dtype=np.intp)
    material = np.zeros((ny, nx, 2))
    face_up = np.zeros((ny, nx), dtype=np.bool_)
    _count(local, cloth.rest, cloth.triangles, hits, layers, material, face_up)
    height = hits.max(axis=2)
    height[layers == 0] = np.nan
    return LayerMap(layers, height, material, face_up, origin, resolution)


@njit()
def _count(
    vertices: NDArray[np.float64],
    rest: NDArray[np.float64],
    triangles: NDArray[np.intp],
    hits: NDArray[np.float64],
    layers: NDArray[np.intp],
    material: NDArray[np.float64],
    face_up: NDArray[np.bool_],
) -> None:
    """Add each triangle to the cells whose centres it covers; x, y in cells."""
    ny, nx, most = hits.shape
    for t in range(triangles.shape[0]):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        a, b, c = vertices[i], vertices[j], vertices[k]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-9:
            continue
        low_x = max(0, int(np.ceil(min(a[0], b[0], c[0]))))
        low_y = max(0, int(np.ceil(min(a[1], b[1], c[1]))))
        high_x = min(nx - 1, int(np.floor(max(a[0], b[0], c[0]))))
        high_y = min(ny - 1, int(np.floor(max(a[1], b[1], c[1]))))
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                if v < 0.0 or w < 0.0 or v + w > 1.0:
                    continue
                z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
                count = layers[y, x]
                top, known = -np.inf, False
                for n in range(min(count, most)):
                    known = known or abs(hits[y, x, n] - z) < _SAME_M
                    top = max(top, hits[y, x, n])
                if known or count >= most:
                    continue
                hits[y, x, count] = z
                layers[y, x] = count + 1
                if z > top:
                    for axis in range(2):
                        material[y, x, axis] = (
                            rest[i, axis]
                            + v * (rest[j, axis] - rest[i, axis])
                            + w * (rest[k, axis] - rest[i, axis])
                        )
                    face_up[y, x] = area > 0.0
