"""Collision checking of the cell, with one clearance per pair of bodies and a step that nothing can slip through."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common import Parallelism
from pydrake.geometry import Box, Capsule, Cylinder, Role, Sphere
from pydrake.multibody.tree import BodyIndex
from pydrake.planning import LinearDistanceAndInterpolationProvider, SceneGraphCollisionChecker

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import ROBOT_INSTANCES, Cell, build_robot_diagram, position_indices


class CollisionModel:
    """Is a thirteen-axis configuration free, with the scenario's clearances? Grippers open, head at its gaze."""

    def __init__(self, cell: Cell, *, contact: bool) -> None:
        """Build the checker.

        Args:
            cell: robot, surroundings, clearances.
            contact: whether the fingers may touch the working table (clearance 0); else they keep `finger_table`.
        """
        diagram = build_robot_diagram(cell)
        plant = diagram.plant()
        robot = [plant.GetModelInstanceByName(name) for name in ROBOT_INSTANCES]
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
        self._set_padding(cell, contact)
        self.reach = axis_reach(cell)
        clearance = cell.scenario.clearance
        self.step = 2.0 * min(clearance.arm_arm, clearance.arm_table)

    def _set_padding(self, cell: Cell, contact: bool) -> None:
        clearance = cell.scenario.clearance
        plant = self._checker.plant()
        table = cell.scenario.table.frame.rpartition("::")[0]
        bodies = []
        for i in range(plant.num_bodies()):
            body = plant.get_body(BodyIndex(i))
            bodies.append((plant.GetModelInstanceName(body.model_instance()), body))
        for instance_a, a in bodies:
            arm = instance_a[:2] if instance_a[:2] in ("r1", "r2") else ""
            if not arm or a.name() == "link_1":
                continue
            for instance_b, b in bodies:
                other = instance_b[:2] if instance_b[:2] in ("r1", "r2") else ""
                if other == arm or self._checker.IsCollisionFilteredBetween(a, b):
                    continue
                if other:
                    padding = clearance.arm_arm
                elif instance_b == table:
                    padding = clearance.arm_table
                    if a.name() == "palm":
                        padding = clearance.palm_table
                    elif a.name().endswith("finger"):
                        padding = 0.0 if contact else clearance.finger_table
                elif b.name() == "r750" and a.name() == "link_2":
                    continue  # the shoulder turns a few millimetres above the carrier
                else:
                    padding = clearance.surroundings
                self._checker.SetPaddingBetween(a, b, padding)

    def positions(self, q: Array) -> Array:
        """The plant's positions (19,) for thirteen axes (13,)."""
        full = self._rest.copy()
        full[self._indices] = q
        return full

    def free(self, q: Array) -> bool:
        """Whether a configuration (13,) keeps every clearance."""
        return bool(self._checker.CheckConfigCollisionFree(self.positions(q)))

    def path_free(self, path: Array) -> bool:
        """Whether a polyline (N, 13) is free, ends and coarse points first, in steps that nothing can slip through."""
        order = np.argsort(_bit_reversed(len(path)))
        if not all(self.free(path[i]) for i in order):
            return False
        return all(self.edge_free(a, b, ends=False) for a, b in pairwise(path))

    def edge_free(self, a: Array, b: Array, *, ends: bool = True) -> bool:
        """Whether the straight joint line from a to b is free.

        The step is chosen so that no two bodies move against each other by more than twice the smaller of the arms'
        clearances between two checked configurations: what keeps that clearance at both cannot have touched in between.
        For pairs with a smaller clearance (palms, fingers, surroundings) that is left to the verification to prove.
        """
        if ends and not (self.free(b) and self.free(a)):
            return False
        steps = int(np.ceil(np.abs(b - a) @ self.reach / self.step))
        for i in np.argsort(_bit_reversed(steps + 1)):
            if 0 < i < steps and not self.free(a + (b - a) * (i / steps)):
                return False
        return True

    def colliding_pair(self, q: Array) -> tuple[str, str] | None:
        """Names of a pair of bodies that is too close, or None."""
        plant = self._checker.plant()
        clearance = self._checker.CalcRobotClearance(self.positions(q), 0.0)
        distances = clearance.distances()
        if len(distances) == 0:
            return None
        i = int(np.argmin(distances))
        names = []
        for index in (clearance.robot_indices()[i], clearance.other_indices()[i]):
            body = plant.get_body(index)
            names.append(f"{plant.GetModelInstanceName(body.model_instance())}::{body.name()}")
        return names[0], names[1]


def _bit_reversed(count: int) -> NDArray[np.int64]:
    """Sort keys that visit 0..count-1 coarse to fine."""
    bits = max(1, int(count - 1).bit_length())
    return np.array([int(format(i, f"0{bits}b")[::-1], 2) for i in range(count)])


def axis_reach(cell: Cell) -> Array:
    """Bound (13,) on how far any point of the robot moves per radian of each axis, m.

    For each axis: the greatest distance, over all configurations, between the axis and any collision geometry it moves. Lengths
    between consecutive joint origins are added; an origin that lies on the axis before it counts from the one before that.
    """
    diagram = build_robot_diagram(cell)
    plant, scene_graph = diagram.plant(), diagram.scene_graph()
    inspector = scene_graph.model_inspector()

    def shapes(instance: str, *names: str) -> Iterator[tuple[Array, Any]]:
        """Centre in the body's frame and shape of the bodies' collision geometry."""
        for name in names:
            body = plant.GetBodyByName(name, plant.GetModelInstanceByName(instance))
            frame = plant.GetBodyFrameIdOrThrow(body.index())
            for geometry in inspector.GetGeometries(frame, Role.kProximity):
                yield (
                    inspector.GetPoseInFrame(geometry).translation(),
                    inspector.GetShape(geometry),
                )

    def radius(instance: str, *names: str) -> float:
        """Greatest distance of a point of the bodies from their frames' origins."""
        return max(
            float(np.linalg.norm(c)) + _shape_radius(shape) for c, shape in shapes(instance, *names)
        )

    gripper = ("palm", "lower_finger", "upper_finger")
    stroke = cell.limits.gripper.stroke
    rows = cell.robot.denavit_hartenberg
    # Lever of each link's origin seen from the joint before it; R turns about the line to B's origin, T about the flange's.
    shoulder, upper = np.hypot(rows[0].a, rows[0].d), rows[1].a
    fore, wrist = np.hypot(rows[2].a, rows[3].d), rows[4].a
    finger = cell.robot.tool_offset - 0.30 + rows[5].d
    tip = finger + radius("r1_gripper", *gripper) + stroke
    beyond_b = max(radius("r1", "link_6"), wrist + tip)
    beyond_u = max(radius("r1", "link_4"), radius("r1", "link_5") + rows[2].a, fore + beyond_b)
    beyond_l = max(radius("r1", "link_3"), upper + beyond_u)
    about_s = max(radius("r1", "link_2"), rows[0].a + beyond_l)
    # The last axis turns the gripper about the palm's z axis.
    turning = stroke + max(
        float(np.hypot(*(np.abs(c) + 0.5 * np.asarray(shape.size()))[:2]))
        for c, shape in shapes("r1_gripper", *gripper)
    )
    arm = [about_s, beyond_l, beyond_u, max(beyond_b, rows[2].a), beyond_b, turning]
    table = cell.robot.arm_offset + shoulder * np.sin(cell.robot.arm_cant) + about_s
    return np.array([table, *arm, *arm])


def _shape_radius(shape: object) -> float:
    if isinstance(shape, Box):
        return 0.5 * float(np.linalg.norm(shape.size()))
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius(), 0.5 * shape.length()))
    if isinstance(shape, Capsule):
        return float(shape.radius() + 0.5 * shape.length())
    if isinstance(shape, Sphere):
        return float(shape.radius())
    raise TypeError(f"no bound known for the shape {type(shape).__name__}")
