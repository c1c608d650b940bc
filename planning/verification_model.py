"""The cell as a verification sees it: Drake's plant, what moves what, and which bodies must keep away from which.

Nothing here is shared with the planner but the model files.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    CalcObb,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HalfSpace,
    QueryObject,
    Role,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, JointIndex, PrismaticJoint, RigidBody

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, build_robot_diagram, position_indices, scoped
from unwrinkle.planning.verification_motion import JOINTS

Array = NDArray[np.float64]

ARMS = (("r1", "r1_gripper"), ("r2", "r2_gripper"))
FINGERS = ("lower_finger", "upper_finger")
ARM_AXES = ((0, 1, 2, 3, 4, 5, 6), (0, 7, 8, 9, 10, 11, 12))


@dataclass(frozen=True)
class BodyPair:
    """Two bodies that the motion moves against each other.

    Attributes:
        names: scoped names.
        bodies: positions in `CellModel.moving` and the like; -1 for a body that nothing moves.
        shared: number of joints that carry both.
        kind: see `PairClearance.kind`.
        required: padding, m; for finger-table outside the contact window.
        arm: which arm's fingers, where the kind is finger-table; else -1.
    """

    names: tuple[str, str]
    bodies: tuple[int, int]
    shared: int
    kind: str
    required: float
    arm: int = -1


class CellModel:
    """Plant, pairs and kinematics of a cell. Building it takes some tenths of a second; not thread-safe.

    Attributes:
        pairs: every pair of bodies that must keep away from each other.
        geometries: per pair of collision shapes its ids, and the index of its bodies in `pairs`.
        chains: per moving body the joints (columns of a leg) that move it, from the world outwards.
        corners: per moving body (8, 3) corners of a box around its shapes, in the child frame of its last joint.
    """

    def __init__(self, cell: Cell) -> None:
        """Build the plant and find the pairs.

        Raises:
            InputError: a model file does not fit, or a shape on a moving body has no bounding box.
        """
        self.cell = cell
        self._diagram = build_robot_diagram(cell)
        self._plant: MultibodyPlant = self._diagram.plant()
        self._root = self._diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        indices = position_indices(cell, self._plant)
        self._columns = np.concatenate([indices.axes, indices.grippers])
        self._positions = self._plant.GetPositions(self._context)
        self._joints = [
            self._plant.GetJointByName(element, self._plant.GetModelInstanceByName(instance))
            for instance, element in map(scoped, [*cell.robot.axes, *cell.robot.grippers])
        ]
        self.prismatic = [isinstance(joint, PrismaticJoint) for joint in self._joints]
        self._tips = [
            self._plant.GetFrameByName("tcp", self._plant.GetModelInstanceByName(gripper))
            for _, gripper in ARMS
        ]
        self._table = self._table_frame()
        self.table_height = float(self._table.CalcPoseInWorld(self._context).translation()[2])
        self._find_bodies()
        self.pairs: list[BodyPair] = []
        self.geometries: list[tuple[GeometryId, GeometryId, int]] = []
        self._find_pairs()

    def set_positions(self, positions: Array) -> QueryObject:
        """Move the cell to (15,) positions of axes and blades; returns the geometry queries there."""
        self._positions[self._columns] = positions
        self._plant.SetPositions(self._context, self._positions)
        return self._plant.get_geometry_query_input_port().Eval(self._context)

    def frames(self, positions: Array) -> tuple[Array, Array]:
        """Poses in the world at each of (n, 15) positions.

        Returns:
            (n, 15, 4, 4) of the joints' child frames (joint axes go through their origins), and (n, 2, 4, 4) of
            the tool centre points' frames.
        """
        children = [joint.frame_on_child() for joint in self._joints]
        X_WJ = np.empty((len(positions), JOINTS, 4, 4))
        X_WT = np.empty((len(positions), 2, 4, 4))
        for i, row in enumerate(positions):
            self._positions[self._columns] = row
            self._plant.SetPositions(self._context, self._positions)
            for j, frame in enumerate(children):
                X_WJ[i, j] = frame.CalcPoseInWorld(self._context).GetAsMatrix4()
            for j, frame in enumerate(self._tips):
                X_WT[i, j] = frame.CalcPoseInWorld(self._context).GetAsMatrix4()
        return X_WJ, X_WT

    def axis_directions(self) -> Array:
        """Directions of the joints' axes in their child frames, (15, 3)."""
        return np.array(
            [
                joint.translation_axis() if prismatic else joint.revolute_axis()
                for joint, prismatic in zip(self._joints, self.prismatic, strict=True)
            ]
        )

    def _table_frame(self) -> Frame:
        name = self.cell.scenario.table.frame
        instance, element = scoped(name)
        try:
            return self._plant.GetFrameByName(element, self._plant.GetModelInstanceByName(instance))
        except RuntimeError as error:
            raise InputError(
                f"the cell's models have no working table '{name}': {error}"
            ) from error

    def _bodies(self) -> Iterator[RigidBody]:
        for i in range(self._plant.num_bodies()):
            yield self._plant.get_body(BodyIndex(i))

    def _shapes(self, body: RigidBody) -> list[GeometryId]:
        return list(self._plant.GetCollisionGeometriesForBody(body))

    def _find_bodies(self) -> None:
        """Follow the joints outwards from the world: which of ours move which body."""
        plant = self._plant
        inboard = {}
        for index in plant.GetJointIndices():
            joint = plant.get_joint(JointIndex(index))
            inboard[joint.child_body().index()] = joint
        column = {joint.index(): i for i, joint in enumerate(self._joints)}
        self._neighbours: set[frozenset[str]] = set()
        self._chain: dict[str, tuple[int, ...]] = {}
        for body in self._bodies():
            chain: list[int] = []
            joint = inboard.get(body.index())
            while joint is not None:
                if joint.index() in column:
                    chain.append(column[joint.index()])
                joint = inboard.get(joint.parent_body().index())
            self._chain[_name(body)] = tuple(reversed(chain))
        for joint in self._joints:
            self._neighbours.add(frozenset((_name(joint.parent_body()), _name(joint.child_body()))))
        solid = [body for body in self._bodies() if self._shapes(body) and self._chain[_name(body)]]
        self.moving = [_name(body) for body in solid]
        self.chains = [self._chain[name] for name in self.moving]
        self.corners = [self._corners(body) for body in solid]

    def _corners(self, body: RigidBody) -> Array:
        inspector = self._diagram.scene_graph().model_inspector()
        last = self._joints[self._chain[_name(body)][-1]].frame_on_child()
        X_JB = last.CalcPoseInWorld(self._context).inverse() @ body.EvalPoseInWorld(self._context)
        points = []
        for geometry in self._shapes(body):
            shape = inspector.GetShape(geometry)
            box = None if isinstance(shape, HalfSpace) else CalcObb(shape)
            if box is None:
                raise InputError(
                    f"{_name(body)} moves, but one of its collision shapes has no bounds"
                )
            corners = _box_corners(-box.half_width(), box.half_width())
            X_JO = X_JB @ inspector.GetPoseInFrame(geometry) @ box.pose()
            points.append(X_JO.multiply(corners.T).T)
        everything = np.vstack(points)
        return _box_corners(everything.min(axis=0), everything.max(axis=0))

    def _find_pairs(self) -> None:
        """List the pairs, and let the scene graph's filter of this context hold exactly them."""
        scene_graph = self._diagram.scene_graph()
        context = scene_graph.GetMyMutableContextFromRoot(self._root)
        filters = scene_graph.collision_filter_manager(context)
        solid = [body for body in self._bodies() if self._shapes(body)]
        everything = GeometrySet(
            list(scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity))
        )
        declaration = CollisionFilterDeclaration().AllowWithin(everything)
        for a, b in combinations(solid, 2):
            pair = self._pair(_name(a), _name(b))
            shapes = self._shapes(a), self._shapes(b)
            if pair is None:
                sets = (GeometrySet(list(ids)) for ids in shapes)
                declaration.ExcludeBetween(*sets)
                continue
            index = len(self.pairs)
            self.pairs.append(pair)
            self.geometries += [(i, j, index) for i in shapes[0] for j in shapes[1]]
        filters.Apply(declaration)

    def _pair(self, a: str, b: str) -> BodyPair | None:
        """How two bodies must keep away from each other; None where they need not.

        They need not where nothing moves one against the other, where one joint joins them (they overlap in it),
        and where they are the two fingers of one gripper (which meet when it closes).
        """
        chains = self._chain[a], self._chain[b]
        if chains[0] == chains[1] or frozenset((a, b)) in self._neighbours:
            return None
        kind, required, arm = self._kind(a, b)
        if kind == "fingers":
            return None
        shared = next(
            (i for i, (j, k) in enumerate(zip(*chains, strict=False)) if j != k),
            min(map(len, chains)),
        )
        bodies = [self.moving.index(name) if self._chain[name] else -1 for name in (a, b)]
        return BodyPair((a, b), (bodies[0], bodies[1]), shared, kind, required, arm)

    def _kind(self, a: str, b: str) -> tuple[str, float, int]:
        clearance = self.cell.scenario.clearance
        sides = _side(a), _side(b)
        table = _name(self._table.body())
        if sides[0] >= 0 and sides[1] >= 0:
            if sides[0] != sides[1]:
                return "arm-arm", clearance.arm_arm, -1
            fingers = _element(a) in FINGERS and _element(b) in FINGERS
            return ("fingers" if fingers else "self"), 0.0, -1
        if table in (a, b) and max(sides) >= 0:
            body = _element(b if a == table else a)
            if body in FINGERS:
                return "finger-table", clearance.finger_table, max(sides)
            if body == "palm":
                return "palm-table", clearance.palm_table, -1
            return "arm-table", clearance.arm_table, -1
        # The shoulder turns on a base that is bolted to the carrier: neighbours but for that weld, near in every
        # position of the axis by construction.
        carrier = _name(self._joints[0].child_body())
        if carrier in (a, b) and any(name.endswith("::link_2") for name in (a, b)):
            return "adjacent", 0.0, -1
        return "surroundings", clearance.surroundings, -1


def _name(body: RigidBody) -> str:
    return str(body.scoped_name().get_full())


def _element(name: str) -> str:
    return scoped(name)[1]


def _side(name: str) -> int:
    """0 for the right arm with its gripper, 1 for the left, -1 for neither."""
    instance = scoped(name)[0]
    return next((i for i, instances in enumerate(ARMS) if instance in instances), -1)


def _box_corners(low: Array, high: Array) -> Array:
    grid = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return np.where(grid == 1, high, low)
