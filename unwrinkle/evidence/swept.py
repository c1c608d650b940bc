"""Space that the robot's bodies pass over a plan, as voxels.

A voxel is counted if a body may touch it at any time: its centre lies within half its diagonal,
plus half of the greatest motion between two samples, of a shape at a sample. The volumes are
therefore too large rather than too small, by about one voxel all around.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.evidence.body_motion import corners
from unwrinkle.evidence.motion import SampledMotion
from unwrinkle.models.arrays import Array
from unwrinkle.viewer.cell_bodies import BodyShape

#: Edge of a voxel, m.
RESOLUTION = 0.025


@dataclass(frozen=True, eq=False)
class SweptSpace:
    """Voxels that bodies pass.

    Attributes:
        resolution: edge of a voxel, m.
        origin: (3,) outer corner of voxel [0, 0, 0] in the world, m.
        groups: names of the groups of bodies.
        passed: (G, nx, ny, nz) voxels of each group.
    """

    resolution: float
    origin: Array
    groups: tuple[str, ...]
    passed: NDArray[np.bool_]

    def volume(self, group: str | None = None) -> float:
        """Return the volume of a group's voxels, of all groups if none is named, m3."""
        chosen = self.passed if group is None else self.passed[[self.groups.index(group)]]
        return float(np.count_nonzero(chosen.any(axis=0)) * self.resolution**3)

    def bounds(self, group: str | None = None) -> tuple[Array, Array]:
        """Return the least and the greatest corner (3,) of a group's voxels, or of all, m."""
        chosen = self.passed if group is None else self.passed[[self.groups.index(group)]]
        cells = np.argwhere(chosen.any(axis=0))
        low, high = cells.min(axis=0), cells.max(axis=0) + 1
        return self.origin + self.resolution * low, self.origin + self.resolution * high


def swept_space(
    motion: SampledMotion, groups: dict[str, list[int]], resolution: float = RESOLUTION
) -> SweptSpace:
    """Mark the voxels that groups of bodies pass.

    Args:
        motion: samples.
        groups: indices of bodies in `motion.names`, by name of the group.
        resolution: edge of a voxel, m.
    """
    low, high = _bounds(motion)
    origin = resolution * (np.floor(low / resolution) - 2.0)
    shape = np.ceil((high - origin) / resolution).astype(int) + 2
    passed = np.zeros((len(groups), *shape), dtype=bool)
    for grid, bodies in zip(passed, groups.values(), strict=True):
        for b in bodies:
            _mark_body(grid, motion, b, origin, resolution)
    return SweptSpace(resolution, origin, tuple(groups), passed)


def _bounds(motion: SampledMotion) -> tuple[Array, Array]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for b, shapes in enumerate(motion.shapes):
        points_B = np.concatenate([corners(shape) for shape in shapes])
        p_W = np.einsum("nij,cj->nci", motion.X_WB[:, b, :3, :3], points_B)
        p_W += motion.X_WB[:, b, None, :3, 3]
        low = np.minimum(low, p_W.min(axis=(0, 1)))
        high = np.maximum(high, p_W.max(axis=(0, 1)))
    return low, high


def _mark_body(
    grid: NDArray[np.bool_], motion: SampledMotion, b: int, origin: Array, resolution: float
) -> None:
    """Mark the voxels that a body may touch, at as few samples as the resolution permits."""
    points_B = np.concatenate([corners(shape) for shape in motion.shapes[b]])
    X_WB = motion.X_WB[:, b]
    p_W = np.einsum("nij,cj->nci", X_WB[:, :3, :3], points_B) + X_WB[:, None, :3, 3]
    moved = np.linalg.norm(np.diff(p_W, axis=0), axis=2).max(axis=1)
    travel = np.concatenate([[0.0], np.cumsum(moved)])
    chosen = [0]
    for k in range(1, len(travel)):
        if k + 1 == len(travel) or travel[k + 1] - travel[chosen[-1]] > resolution:
            chosen.append(k)
    gap = float(np.diff(travel[chosen]).max(initial=0.0))
    room = 0.5 * np.sqrt(3.0) * resolution + 0.5 * gap
    for k in chosen:
        for shape in motion.shapes[b]:
            _mark_shape(grid, X_WB[k] @ shape.X_BG, shape, room, origin, resolution)


def _mark_shape(
    grid: NDArray[np.bool_],
    X_WG: Array,
    shape: BodyShape,
    room: float,
    origin: Array,
    resolution: float,
) -> None:
    half = 0.5 * np.array(shape.size)
    # An ellipsoid with longer half axes would not hold all points within `room`: it is scaled.
    half = half * (1.0 + room / half.min()) if shape.kind == "ellipsoid" else half + room
    reach = np.abs(X_WG[:3, :3]) @ half
    first = np.maximum(np.floor((X_WG[:3, 3] - reach - origin) / resolution - 0.5), 0).astype(int)
    last = np.ceil((X_WG[:3, 3] + reach - origin) / resolution - 0.5).astype(int) + 1
    last = np.minimum(last, grid.shape)
    axes = [
        origin[i] + resolution * (np.arange(first[i], last[i]) + 0.5) - X_WG[i, 3] for i in range(3)
    ]
    # Centres in the shape's frame, one axis of the grid after the other.
    R = X_WG[:3, :3]
    local = (
        axes[0][:, None, None, None] * R[0]
        + axes[1][None, :, None, None] * R[1]
        + axes[2][None, None, :, None] * R[2]
    )
    share = local / half
    if shape.kind == "box":
        inside = np.abs(share).max(axis=-1) <= 1.0
    elif shape.kind == "cylinder":
        inside = (np.hypot(share[..., 0], share[..., 1]) <= 1.0) & (np.abs(share[..., 2]) <= 1.0)
    else:
        inside = np.sum(share**2, axis=-1) <= 1.0
    block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    grid[block] |= inside
