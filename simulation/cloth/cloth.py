"""Cloth on a table: small-step XPBD on a structured grid, with plastic bending.

Every substep (Macklin 2019, "Small steps in physics simulation") predicts the positions by the
velocities and then projects each constraint once: shear along the diagonals and yarns in both
directions, each line of nodes by a direct solver; bending along four directions; self-contact;
contact with table and floor with exact stiction. The solver runs on one thread without reductions,
so that results are reproducible bit by bit.
"""

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.cloth import ClothMaterial
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.simulation.cloth._solver.arrays import cloth_arrays
from unwrinkle.simulation.cloth._solver.memory import ClothMemory
from unwrinkle.simulation.cloth.outlines import Outline
from unwrinkle.simulation.cloth.state import (
    HANDS,
    ClothError,
    ClothState,
    Grip,
    Grips,
    checked_pose,
)

__all__ = ["Cloth", "ClothError", "ClothState", "Grip"]

#: Gravity in the world, m/s^2.
GRAVITY = (0.0, 0.0, -9.81)

#: Radius of the patch that a closed gripper holds, m.
GRASP_RADIUS = 0.015

#: Interval of the sleep test, s.
STRIDE_TIME = 0.020

#: Mean speed over that interval below which a node is at rest, m/s.
QUIET_SPEED = 2e-3

#: Fraction of the nodes that must be at rest; compressed layers may jitter in a few places.
QUIET_SHARE = 0.995

#: Limit of the other nodes' speed, multiples of the rest speed.
QUIET_REST = 5.0

#: Time at rest after which the cloth falls asleep, s.
QUIET_TIME = 0.1

#: Limit of a hand's speed, m/s; a faster motion is refused as a jump.
MOST_HAND_SPEED = 5.0

#: Displacement of the held nodes below which a hand is at rest, m.
_STILL_M = 1e-6

Hands = Sequence[NDArray[np.floating[Any]] | None]


class Cloth:
    """Simulator of a garment of a material on a table.

    It holds scratch memory but no state. The first call compiles the kernels (about 15 s; cached).
    """

    def __init__(
        self,
        outline: Outline,
        material: ClothMaterial,
        table: Table,
        *,
        time_step: float = 1e-3,
        gravity: tuple[float, float, float] = GRAVITY,
        clamped: Sequence[int] = (),
        grasp_radius: float = GRASP_RADIUS,
    ) -> None:
        """Prepare the solver.

        Args:
            outline: nodes of the cloth.
            material: of the cloth.
            table: supports the cloth; beyond its edge cloth falls to the floor at z = 0.
            time_step: duration of a substep, s.
            gravity: in the world, m/s^2; a tilted vector simulates an inclined table.
            clamped: numbers of fixed nodes.
            grasp_radius: radius of the patch around a tool's tip that its gripper holds, m.

        Raises:
            InputError: a value is out of range, or the time step is too long for the material.
        """
        material.check()
        if not (np.isfinite(time_step) and 0.0 < time_step <= 5e-3):
            raise InputError(f"cloth: time step {time_step:g} s; give above 0, up to 0.005")
        if np.shape(gravity) != (3,) or not np.isfinite(gravity).all():
            raise InputError(f"cloth: gravity {gravity}; give three finite values in m/s^2")
        if not (np.isfinite(grasp_radius) and grasp_radius > 0.0):
            raise InputError(f"cloth: grasp radius {grasp_radius:g} m; give one above 0")
        self._clamped = np.unique(np.asarray(clamped, dtype=np.intp))
        beyond = self._clamped[(self._clamped < 0) | (self._clamped >= outline.mask.size)]
        if len(beyond) or not outline.mask.ravel()[self._clamped].all():
            raise InputError(
                "cloth: a clamped node is no node of the cloth; give numbers i * ny + j"
            )
        diffusion = material.viscosity * time_step / outline.spacing**2
        if diffusion > 0.24:
            most = 0.24 * outline.spacing**2 / material.viscosity
            raise InputError(
                f"cloth: time step {time_step:g} s is too long for the viscosity at this spacing; "
                f"give at most {most:.2g} s"
            )
        self.outline = outline
        self.material = material
        self.table = table
        self.time_step = float(time_step)
        self.gravity = (float(gravity[0]), float(gravity[1]), float(gravity[2]))
        self.grasp_radius = float(grasp_radius)
        self.shape = (outline.mask.shape[0], outline.mask.shape[1])
        self._arrays = cloth_arrays(outline, material, time_step, self._clamped)
        self._memory = ClothMemory(
            self._arrays,
            outline.mask,
            outline.spacing,
            material,
            table,
            self.gravity,
            self.time_step,
        )

    @property
    def size(self) -> int:
        """Number S of nodes of the grid."""
        return self.shape[0] * self.shape[1]

    @property
    def flat_height(self) -> float:
        """World z of a flat cloth's nodes, m: half its thickness above the table."""
        return self.table.height + 0.5 * self.material.thickness

    @property
    def numbers(self) -> NDArray[np.intp]:
        """Grid numbers (n,) of the nodes that are cloth, in the order of `vertices`."""
        return self._arrays.numbers

    @property
    def triangles(self) -> NDArray[np.intp]:
        """Triangles (m, 3) of indices into `vertices`, counter-clockwise seen from above."""
        return self._arrays.triangles

    @property
    def rest(self) -> NDArray[np.float64]:
        """Positions (n, 2) of the vertices in the cloth's plane, m."""
        return self._arrays.rest

    @property
    def boundary(self) -> NDArray[np.intp]:
        """Indices (k,) of the vertices on the garment's border."""
        cells = np.pad(self.outline.cells, 1)
        inner = cells[:-1, :-1] & cells[1:, :-1] & cells[:-1, 1:] & cells[1:, 1:]
        return np.flatnonzero(~inner.ravel()[self.numbers])

    def vertices(self, state: ClothState) -> NDArray[np.float64]:
        """Return the world positions (n, 3) of the nodes that are cloth, m."""
        self._check(state)
        return state.positions[:, self.numbers].T.copy()

    def flat(self, centre: tuple[float, float], yaw: float = 0.0) -> ClothState:
        """Return the cloth flat on the table, asleep.

        Args:
            centre: world x, y of the centre of its grid, m.
            yaw: angle of its x axis from the world's, rad.

        Raises:
            InputError: a value is not finite, or a part of the cloth is off the table.
        """
        if np.shape(centre) != (2,) or not np.isfinite([*centre, yaw]).all():
            raise InputError(f"cloth: centre {centre}, yaw {yaw}; give finite (x, y) and angle")
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        place = self.outline.plane.reshape(-1, 2) @ turn.T + np.asarray(centre)
        reach = np.abs(place[self.numbers] - self.table.centre).max(axis=0)
        over = float((reach - 0.5 * np.asarray(self.table.size)).max())
        if over > 1e-9:
            raise InputError(
                f"cloth: a flat {self.outline.name} at ({centre[0]:g}, {centre[1]:g}) reaches "
                f"{1e3 * over:.0f} mm beyond the table; move it or take a smaller garment"
            )
        positions = np.vstack([place.T, np.full(self.size, self.flat_height)])
        zeros = np.zeros((3, self.size))
        return ClothState(0.0, positions, zeros, np.zeros((4, self.size)), asleep=True)

    def grip(self, state: ClothState, hand: int, X_WT: NDArray[np.floating[Any]]) -> ClothState:
        """Close a gripper; it holds the nodes within the grasp radius of its tip (T's origin).

        Without such nodes `grips[hand]` stays None. Nodes in the other hand stay there.

        Raises:
            InputError: bad pose, unknown hand, or the hand holds cloth already.
        """
        self._check(state)
        self._check_hand(hand)
        pose = checked_pose(X_WT, f"{HANDS[hand]} hand")
        if state.grips[hand] is not None:
            raise InputError(f"cloth: the {HANDS[hand]} hand holds cloth already; release it first")
        distance = np.linalg.norm(state.positions.T - pose[:3, 3], axis=1)
        free = self.outline.mask.ravel() & (distance <= self.grasp_radius)
        free[self._clamped] = False
        other = state.grips[1 - hand]
        if other is not None:
            free[other.nodes] = False
        nodes = np.flatnonzero(free)
        if len(nodes) == 0:
            return state
        p_TN = (state.positions[:, nodes].T - pose[:3, 3]) @ pose[:3, :3]
        return dc.replace(state, grips=_with(state.grips, hand, Grip(nodes, p_TN, pose)))

    def release(self, state: ClothState, hand: int) -> ClothState:
        """Open a gripper; return the state unchanged if the hand holds nothing.

        Raises:
            InputError: unknown hand.
        """
        self._check(state)
        self._check_hand(hand)
        if state.grips[hand] is None:
            return state
        return dc.replace(state, grips=_with(state.grips, hand, None), asleep=False, quiet=0.0)

    def advance(
        self, state: ClothState, duration: float, hands: Hands = (None, None)
    ) -> ClothState:
        """Advance a state by a duration.

        Args:
            state: a state of this cloth. If it is asleep and no hand moves, only its time advances.
            duration: s, a multiple of the time step.
            hands: X_WT (4, 4) of the right and the left tool at the end; None for no motion. Held
                nodes move there along straight lines.

        Raises:
            InputError: bad duration, pose or state, or a hand is too fast.
            ClothError: the solver failed.
        """
        self._check(state)
        return self._advanced(state, duration, hands, QUIET_SPEED, until_asleep=False)

    def settle(
        self, state: ClothState, most: float = 3.0, speed: float = QUIET_SPEED
    ) -> ClothState:
        """Advance a state until it is at rest, for at most `most` seconds.

        At rest: for 0.1 s the mean speed of 99.5 % of the nodes is below `speed` (m/s) and that of
        the others below five times `speed`. The state is then asleep.

        Raises:
            InputError: the speed is not usable, or the time is not finite.
            ClothError: the solver failed.
        """
        self._check(state)
        if not (np.isfinite(speed) and speed > 0.0):
            raise InputError(f"cloth: settling speed {speed:g} m/s; give one above 0")
        count = max(1, round(most / self.time_step)) if np.isfinite(most) else 0
        return self._advanced(state, count * self.time_step, (None, None), speed, until_asleep=True)

    def _advanced(
        self, state: ClothState, duration: float, hands: Hands, speed: float, *, until_asleep: bool
    ) -> ClothState:
        count = round(duration / self.time_step) if np.isfinite(duration) else 0
        if count < 1 or abs(count * self.time_step - duration) > 1e-6 * self.time_step * count:
            raise InputError(
                f"cloth: cannot advance by {duration} s; give a multiple of the time step "
                f"{self.time_step:g} s"
            )
        grips = self._moved(state.grips, hands)
        nodes = np.concatenate(
            [np.empty(0, dtype=np.intp), *(g.nodes for g in grips if g is not None)]
        )
        begin = np.ascontiguousarray(state.positions[:, nodes].T)
        end = np.concatenate([np.empty((0, 3)), *(g.at(g.X_WT) for g in grips if g is not None)])
        travel = float(np.abs(end - begin).max(initial=0.0))
        if travel > MOST_HAND_SPEED * duration:
            raise InputError(
                f"cloth: a hand moves its cloth {travel:.3f} m in {duration:g} s; "
                "give its pose at shorter intervals"
            )
        moving = travel > _STILL_M
        if state.asleep and not moving:
            return dc.replace(state, time=state.time + duration)
        memory = self._memory
        memory.write(state, nodes)
        stride = max(1, round(STRIDE_TIME / self.time_step))
        quiet, done = 0.0 if moving else state.quiet, 0
        asleep = False
        while done < count and not asleep:
            steps = min(stride, count - done)
            a, b = done / count, (done + steps) / count
            before = memory.places()
            memory.run(steps, begin + a * (end - begin), begin + b * (end - begin))
            done += steps
            if not moving:
                passed = steps * self.time_step
                moved = np.linalg.norm(memory.places() - before, axis=0)
                quiet = quiet + passed if _at_rest(moved, speed * passed) else 0.0
                asleep = quiet >= QUIET_TIME - 1e-9
        time = state.time + (done * self.time_step if until_asleep else duration)
        positions, velocities, curvatures = memory.read(time)
        if asleep:
            velocities = np.zeros_like(velocities)
        return ClothState(time, positions, velocities, curvatures, grips, asleep, quiet)

    def _moved(self, grips: Grips, hands: Hands) -> Grips:
        if len(hands) != 2:
            raise InputError(f"cloth: poses of {len(hands)} hands; give right and left, or None")
        moved: list[Grip | None] = []
        for name, grip, X_WT in zip(HANDS, grips, hands, strict=True):
            if grip is not None and X_WT is not None:
                grip = dc.replace(grip, X_WT=checked_pose(X_WT, f"{name} hand"))
            moved.append(grip)
        return moved[0], moved[1]

    def _check(self, state: ClothState) -> None:
        if state.positions.shape[1] != self.size:
            raise InputError(
                f"cloth: a state of {state.positions.shape[1]} nodes for a {self.outline.name} "
                f"of {self.size}; give a state of the same outline"
            )

    @staticmethod
    def _check_hand(hand: int) -> None:
        if hand not in (0, 1):
            raise InputError(f"cloth: no hand {hand}; 0 is the right, 1 the left")


def _with(grips: Grips, hand: int, grip: Grip | None) -> Grips:
    return (grip, grips[1]) if hand == 0 else (grips[0], grip)


def _at_rest(moved: NDArray[np.float64], most: float) -> bool:
    return bool(np.quantile(moved, QUIET_SHARE) < most and moved.max() < QUIET_REST * most)
