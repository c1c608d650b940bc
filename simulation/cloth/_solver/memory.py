"""Buffers of the cloth solver: write a state, run substeps, read it back."""

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.cloth import ClothMaterial
from unwrinkle.models.table import Table
from unwrinkle.simulation.cloth._solver.arrays import ClothArrays, places_of
from unwrinkle.simulation.cloth._solver.contact import OVERFLOW
from unwrinkle.simulation.cloth._solver.step import substeps
from unwrinkle.simulation.cloth.layout import get, put
from unwrinkle.simulation.cloth.state import ClothError, ClothState

#: Limit of a node's speed, m/s: contacts resolved within one substep would eject it.
MOST_SPEED = 5.0

#: Length of a spring, multiples of its rest length, beyond which the solver has failed.
_MAX_STRETCH = 3.0

#: Capacity of the list of contact pairs per node.
_PAIRS_PER_NODE = 60
_POSITIONS = ("x", "y", "z")
_VELOCITIES = ("vx", "vy", "vz")
_CURVATURES = ("rest", "rest_rising", "rest_falling")


class ClothMemory:
    """Solver buffers of one cloth; their contents are valid between `write` and `read` only."""

    def __init__(
        self,
        arrays: ClothArrays,
        mask: NDArray[np.bool_],
        spacing: float,
        material: ClothMaterial,
        table: Table,
        gravity: tuple[float, float, float],
        step: float,
    ) -> None:
        """Compute the constants and allocate the buffers."""
        self._arrays, self._mask, self._spacing, self._step = arrays, mask, spacing, step
        self._rows, self._turned = arrays.rows.copy(), arrays.turned.copy()
        most = _PAIRS_PER_NODE * len(arrays.places)
        self._pairs, self._sides = np.empty((most, 2), dtype=np.uint64), np.empty(most)
        self._gravity = gravity
        half, h, thickness = 0.5 * material.thickness, spacing, material.thickness
        x, y = (float(value) for value in table.centre)
        half_x, half_y = (0.5 * float(value) for value in table.size)
        edge = min(h, half_x, half_y)  # one spacing: some node is always on the rounded edge
        self._table = (x, y, half_x, half_y, table.height + half, half, edge)
        slip = material.yield_curvature * h * h
        self._bends = (slip, 2.0 * slip, material.plastic_bending / material.first_bending)
        self._contact = (
            material.friction,
            thickness,
            material.self_friction,
            max(3.0 * h, 3.0 * thickness),
            2.0 * thickness,
            max(h, 2.0 * thickness),
        )
        self._damping = (material.air_drag, material.viscosity * step / h**2, MOST_SPEED)

    def write(self, state: ClothState, held: NDArray[np.intp]) -> None:
        """Write a state; the nodes numbered `held` get infinite mass."""
        shape = self._mask.shape
        for names, values in (
            (_POSITIONS, state.positions),
            (_VELOCITIES, state.velocities),
            (_CURVATURES, state.curvatures[:3]),
        ):
            for name, value in zip(names, values, strict=True):
                put(self._rows, name, value.reshape(shape))
        put(self._turned, "rest", state.curvatures[3].reshape(shape).T)
        weights = self._arrays.inverse_mass.copy()
        weights[held] = 0.0
        put(self._rows, "w0", weights.reshape(shape))
        self._held = places_of(held, shape[1])

    def run(self, count: int, begin: NDArray[np.float64], end: NDArray[np.float64]) -> None:
        """Run `count` substeps while the held nodes move from `begin` to `end`, (k, 3), m.

        Raises:
            ClothError: too many contact pairs, or the positions diverged.
        """
        arrays = self._arrays
        found = substeps(
            self._rows.reshape(-1),
            self._turned.reshape(-1),
            arrays.yarn_j.reshape(-1),
            self._mask.shape[0],
            self._mask.shape[1],
            count,
            self._step,
            self._spacing,
            self._gravity,
            self._table,
            self._bends,
            self._contact,
            self._damping,
            self._held,
            begin,
            end,
            arrays.places,
            arrays.rest,
            arrays.triangle_places,
            arrays.centres,
            self._pairs,
            self._sides,
        )
        if found == OVERFLOW:
            raise ClothError(
                f"cloth: touches itself in more than {len(self._pairs)} places, or flew apart; it "
                "is a knot, or the solver failed: take a shorter time step or slower hands"
            )

    def places(self) -> NDArray[np.float64]:
        """Return a copy of the positions (3, n) of the nodes that are cloth, m."""
        return self._planes(_POSITIONS)[:, self._arrays.numbers]

    def read(
        self, time: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return positions (3, S), velocities (3, S) and curvatures (4, S).

        Raises:
            ClothError: a value is not finite, or a yarn is torn; the message states `time`.
        """
        positions, velocities = self._planes(_POSITIONS), self._planes(_VELOCITIES)
        last = get(self._turned, "rest", self._mask.shape[0]).T.ravel()
        curvatures = np.vstack([self._planes(_CURVATURES), last])
        if not all(np.isfinite(value).all() for value in (positions, velocities, curvatures)):
            raise ClothError(
                f"cloth: the solver failed at {time:.3f} s (not finite); take a shorter time step "
                "or slower hands"
            )
        mask, grid = self._mask, positions.reshape(3, *self._mask.shape)
        for axis, joined in ((1, mask[1:] & mask[:-1]), (2, mask[:, 1:] & mask[:, :-1])):
            length = np.linalg.norm(np.diff(grid, axis=axis), axis=0)[joined]
            stretch = float(length.max()) / self._spacing
            if stretch > _MAX_STRETCH:
                raise ClothError(
                    f"cloth: torn at {time:.3f} s, a yarn is {stretch:.1f} times its length; "
                    "the hands pull too far apart, or take a shorter time step"
                )
        return positions, velocities, curvatures

    def _planes(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        columns = self._mask.shape[1]
        return np.stack([get(self._rows, name, columns).ravel() for name in names])
