"""Collision checking of the cell, with one clearance per pair of bodies and a step bounded by the
smaller arm clearance.
"""

import copy
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.common import Parallelism
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.planning import LinearDistanceAndInterpolationProvider, SceneGraphCollisionChecker

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, position_indices, scoped
from unwrinkle.planning.robot.axis_reach import axis_reach


class CollisionModel:
    """Checks configurations of the robot against the scenario's clearances; grippers open, head at
    the scenario's gaze.

    Attributes:
        reach: (axes,) bound on how far any point of the robot moves per radian of each axis, m; see
            `axis_reach`.
        step: greatest relative motion of two bodies between two checked configurations of an edge,
            m.
    """

    def __init__(self, cell: Cell, *, contact: bool) -> None:
        """Build the checker.

        Args:
            cell: robot, surroundings, clearances.
            contact: whether the fingers may touch the working table (clearance 0); else they keep
                `finger_table`.

        Raises:
            InputError: the models lack a link that the robot's description gives a role.
        """
        diagram = cell.diagram
        plant = diagram.plant()
        robot = [plant.GetModelInstanceByName(name) for name in cell.robot.instances]
        self._checker = SceneGraphCollisionChecker(
            model=diagram,
            robot_model_instances=robot,
            distance_and_interpolation_provider=LinearDistanceAndInterpolationProvider(plant),
            edge_step_size=0.05,
            env_collision_padding=0.0,
            self_collision_padding=0.0,
            implicit_context_parallelism=Parallelism(num_threads=1),
        )
        self._indices = position_indices(cell, plant).axes
        self._rest = plant.GetPositions(plant.CreateDefaultContext())
        self._cell = cell
        self._set_padding(cell, contact)
        self.reach = axis_reach(cell)
        clearance = cell.scenario.clearance
        self.step = 2.0 * min(clearance.arm_arm, clearance.arm_table)

    def with_contact(self, contact: bool) -> "CollisionModel":
        """Return the same model with another clearance of the fingers from the working table."""
        other = copy.copy(self)
        other._checker = cast(SceneGraphCollisionChecker, self._checker.Clone())
        other._set_padding(self._cell, contact)
        return other

    def _set_padding(self, cell: Cell, contact: bool) -> None:
        """Set the clearance of every pair of bodies that an arm can move against each other."""
        plant, robot = self._checker.plant(), cell.robot
        bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
        _check_roles(cell, {_name(body) for body in bodies})
        adjacent = {frozenset(pair) for pair in robot.adjacent}
        # The link that carries an arm's first axis is bolted to the carrier: the arm does not move
        # it.
        bases = set()
        for arm in robot.arms:
            instance, joint = scoped(robot.axes[arm.axes[0]])
            first = plant.GetJointByName(joint, plant.GetModelInstanceByName(instance))
            bases.add(first.parent_body().index())
        for a in bodies:
            own = robot.arm_of(scoped(_name(a))[0])
            if own is None or a.index() in bases:
                continue
            for b in bodies:
                other = robot.arm_of(scoped(_name(b))[0])
                if other == own or self._checker.IsCollisionFilteredBetween(a, b):
                    continue
                if frozenset((_name(a), _name(b))) not in adjacent:
                    padding = _padding(cell, a, b, contact)
                    self._checker.SetPaddingBetween(a, b, padding)

    def positions(self, q: Array) -> Array:
        """Return the plant's positions for the robot's axes (axes,), rad.

        Blades and head at their defaults.
        """
        full = self._rest.copy()
        full[self._indices] = q
        return full

    def free(self, q: Array) -> bool:
        """Return whether a configuration (axes,), rad, keeps every clearance."""
        return bool(self._checker.CheckConfigCollisionFree(self.positions(q)))

    def path_free(self, path: Array) -> bool:
        """Return whether a polyline (N, axes), rad, keeps every clearance.

        Coarse points are checked first.
        """
        order = np.argsort(_bit_reversed(len(path)))
        if not all(self.free(path[i]) for i in order):
            return False
        return all(self.edge_free(a, b, ends=False) for a, b in pairwise(path))

    def edge_free(self, a: Array, b: Array, *, ends: bool = True) -> bool:
        """Return whether the straight joint line from a to b, (axes,) each, rad, keeps every
        clearance at its steps.

        Between two checked configurations no two bodies move against each other by more than twice
        the smaller of the arms' clearances, so a pair that keeps that clearance at both cannot
        touch in between. Pairs with a smaller clearance (palms, fingers, surroundings) have no such
        bound here; the verification bounds them between its samples.

        Args:
            a: start of the line.
            b: end of the line.
            ends: check both ends too.
        """
        if ends and not (self.free(b) and self.free(a)):
            return False
        steps = int(np.ceil(np.abs(b - a) @ self.reach / self.step))
        for i in np.argsort(_bit_reversed(steps + 1)):
            if 0 < i < steps and not self.free(a + (b - a) * (i / steps)):
                return False
        return True

    def colliding_pair(self, q: Array) -> tuple[str, str] | None:
        """Return the scoped names of the pair of bodies that is deepest in its clearance, or None
        if there is no pair.
        """
        plant = self._checker.plant()
        clearance = self._checker.CalcRobotClearance(self.positions(q), 0.0)
        distances = clearance.distances()
        if len(distances) == 0:
            return None
        i = int(np.argmin(distances))
        names = []
        for index in (clearance.robot_indices()[i], clearance.other_indices()[i]):
            names.append(_name(plant.get_body(index)))
        return names[0], names[1]


def _bit_reversed(count: int) -> NDArray[np.int64]:
    """Return sort keys (count,) that visit 0..count-1 from coarse to fine."""
    bits = max(1, int(count - 1).bit_length())
    return np.array([int(format(i, f"0{bits}b")[::-1], 2) for i in range(count)])


def _name(body: RigidBody) -> str:
    return str(body.scoped_name().get_full())


def _padding(cell: Cell, a: RigidBody, b: RigidBody, contact: bool) -> float:
    """Return the clearance, m, that a body `a` of an arm keeps from `b`, not of that arm."""
    clearance, robot = cell.scenario.clearance, cell.robot
    instance = scoped(_name(b))[0]
    if robot.arm_of(instance) is not None:
        return clearance.arm_arm
    if instance != scoped(cell.scenario.table.frame)[0]:
        return clearance.surroundings
    if a.name() == robot.palm:
        return clearance.palm_table
    if a.name() in robot.fingers:
        return 0.0 if contact else clearance.finger_table
    return clearance.arm_table


def _check_roles(cell: Cell, names: set[str]) -> None:
    """Refuse roles of links that the models do not have: a misspelt one would get another
    clearance.

    Raises:
        InputError: naming the missing link.
    """
    robot = cell.robot
    wanted = [name for pair in robot.adjacent for name in pair]
    wanted += [
        f"{arm.gripper}::{link}" for arm in robot.arms for link in (robot.palm, *robot.fingers)
    ]
    for name in wanted:
        if name not in names:
            raise InputError(
                f"{cell.scenario.robot}: the cell's models have no link '{name}'; check `palm`, "
                "`fingers`, `adjacent`"
            )
