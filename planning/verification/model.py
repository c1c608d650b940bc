"""The verification's model of a cell: Drake's plant, kinematic chains, and the pairs of bodies with
their clearances.

Only the model files are shared with the planner.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    QueryObject,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Frame,
    Joint,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
)

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, position_indices, scoped
from unwrinkle.planning.verification.motion import JOINTS
from unwrinkle.planning.verification.shapes import box_corners, outlines


@dataclass(frozen=True)
class BodyPair:
    """Two bodies that can move relative to each other.

    Attributes:
        names: scoped names.
        bodies: indices in `CellModel.moving`; -1 for a body that no joint moves.
        shared: number of joints that carry both.
        kind: see `PairClearance.kind`.
        required: clearance, m; for finger-table outside the contact window.
        arm: index of the arm for the kind finger-table; else -1.
    """

    names: tuple[str, str]
    bodies: tuple[int, int]
    shared: int
    kind: str
    required: float
    arm: int = -1


class CellModel:
    """Plant, pairs of bodies and kinematics of a cell. Building it takes some tenths of a second;
    not thread-safe.

    Attributes:
        pairs: all pairs of bodies with a clearance.
        shapes: outlines of all collision shapes.
        first: (G,) first shape of each pair of shapes with a clearance.
        second: (G,) second shape.
        pair_of: (G,) index of their bodies in `pairs`.
        reach: (G,) sum of the radii of their bounding spheres, m.
        table_height: of the working table, m.
        tool_chains: per arm the joints (columns of a leg) that move its tool centre point, from the
            world outwards.
        chains: per moving body the joints (columns of a leg) that move it, from the world outwards.
        corners: per moving body the corners (8, 3) of a box around its shapes, in the child frame
            of its last joint.
    """

    def __init__(self, cell: Cell) -> None:
        """Build the plant and find the pairs.

        Raises:
            InputError: a model file does not fit, or a shape on a moving body has no bounding box.
        """
        self.cell = cell
        self._diagram = cell.diagram
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
            self._plant.GetFrameByName("tcp", self._plant.GetModelInstanceByName(arm.gripper))
            for arm in cell.robot.arms
        ]
        self._table = self._table_frame()
        self._X_WS = self._table.CalcPoseInWorld(self._context).GetAsMatrix4()
        self.table_height = float(self._X_WS[2, 3])
        self._find_bodies()
        self._check_roles()
        self.tool_chains = [self._chain[_name(frame.body())] for frame in self._tips]
        self.pairs: list[BodyPair] = []
        self._find_pairs()

    def set_positions(self, positions: Array) -> QueryObject:
        """Set the positions (15,) of axes, rad, and blades, m.

        Return the geometry queries there.
        """
        self._positions[self._columns] = positions
        self._plant.SetPositions(self._context, self._positions)
        return self._plant.get_geometry_query_input_port().Eval(self._context)

    def frames(self, positions: Array) -> tuple[Array, Array]:
        """Compute poses in the world at each of (n, 15) positions.

        Returns:
            (n, 15, 4, 4) of the joints' child frames (joint axes go through their origins), and (n,
            2, 4, 4) of the tool centre points' frames.
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

    def beyond_table(self, places: Array) -> Array:
        """Return how far places (..., 2) in the world lie beyond the nearest edge of the working
        table, m; negative on it.
        """
        local = (np.asarray(places) - self._X_WS[:2, 3]) @ self._X_WS[:2, :2]
        beyond = np.abs(local) - 0.5 * np.asarray(self.cell.scenario.table.size)
        return np.asarray(beyond.max(axis=-1))

    def axis_directions(self) -> Array:
        """Return the directions (15, 3) of the joints' axes in their child frames."""
        return np.array([_axis(joint) for joint in self._joints])

    def outline_poses(self, X_WJ: Array) -> tuple[Array, Array]:
        """Return axes (n, N, 3, 3) and centres (n, N, 3) of the shapes' outlines in the world.

        Args:
            X_WJ: (n, 15, 4, 4) as from `frames`.
        """
        # Index -1, of shapes that no joint moves, is the world.
        fixed = np.broadcast_to(np.eye(4), (len(X_WJ), 1, 4, 4))
        X_WS = np.concatenate([X_WJ, fixed], axis=1)[:, self._shape_joint] @ self._X_JS
        return X_WS[..., :3, :3], X_WS[..., :3, 3]

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
        """Find the chain of joints that moves each body."""
        plant = self._plant
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        inboard = {each.child_body().index(): each for each in joints}
        column = {joint.index(): i for i, joint in enumerate(self._joints)}
        self._neighbours: set[frozenset[str]] = set()
        self._chain: dict[str, tuple[int, ...]] = {}
        for body in self._bodies():
            chain: list[int] = []
            carried_by = inboard.get(body.index())
            while carried_by is not None:
                if carried_by.index() in column:
                    chain.append(column[carried_by.index()])
                carried_by = inboard.get(carried_by.parent_body().index())
            self._chain[_name(body)] = tuple(reversed(chain))
        for joint in self._joints:
            self._neighbours.add(frozenset((_name(joint.parent_body()), _name(joint.child_body()))))
        solid = [body for body in self._bodies() if self._shapes(body)]
        ids = [i for body in solid for i in self._shapes(body)]
        inspector = self._diagram.scene_graph().model_inspector()
        self.shapes = outlines(inspector, ids, "the cell's models")
        carriers, X_JS = [], []
        for body in solid:
            carrier = (-1, *self._chain[_name(body)])[-1]
            X_JB = body.EvalPoseInWorld(self._context)
            if carrier >= 0:
                last = self._joints[carrier].frame_on_child()
                X_JB = last.CalcPoseInWorld(self._context).inverse() @ X_JB
            for i in self._shapes(body):
                carriers.append(carrier)
                X_JS.append((X_JB @ inspector.GetPoseInFrame(i)).GetAsMatrix4())
        X_GS = np.tile(np.eye(4), (len(ids), 1, 1))
        X_GS[:, :3, :3], X_GS[:, :3, 3] = self.shapes.R_GS, self.shapes.p_GS
        self._shape_joint = np.array(carriers, dtype=np.intp)
        self._X_JS = np.array(X_JS) @ X_GS
        self.moving = [_name(body) for body in solid if self._chain[_name(body)]]
        self.chains = [self._chain[name] for name in self.moving]
        self._solid = {_name(body): self._indices(body) for body in solid}
        self.corners = [self._corners(self._solid[name]) for name in self.moving]

    def _indices(self, body: RigidBody) -> list[int]:
        return [self.shapes.ids.index(i) for i in self._shapes(body)]

    def _check_roles(self) -> None:
        """Refuse roles that would silently change a required clearance.

        Raises:
            InputError: a link that the models do not have, or an adjacent pair with more than one
                joint between.
        """
        robot = self.cell.robot
        wanted = [name for pair in robot.adjacent for name in pair]
        for arm in robot.arms:
            wanted += [f"{arm.gripper}::{link}" for link in (robot.palm, *robot.fingers)]
        for name in wanted:
            if name not in self._chain:
                raise InputError(
                    f"the cell's models have no link '{name}', to which the robot's description "
                    "gives a role"
                )
        near = set()
        for joint in self._joints:
            for body in self._plant.GetBodiesWeldedTo(joint.parent_body()):
                if self._chain[_name(body)]:
                    near.add(frozenset((_name(body), _name(joint.child_body()))))
        for pair in robot.adjacent:
            if frozenset(pair) not in near:
                raise InputError(
                    f"the robot's description exempts {' and '.join(pair)} from a clearance; only "
                    "a link and what carries its joint may be exempt"
                )

    def _corners(self, shapes: list[int]) -> Array:
        points = [
            self.shapes.corners(i) @ self._X_JS[i, :3, :3].T + self._X_JS[i, :3, 3] for i in shapes
        ]
        everything = np.vstack(points)
        return box_corners(everything.min(axis=0), everything.max(axis=0))

    def _find_pairs(self) -> None:
        """List the pairs, and remove all collision filters of the models so that the query covers
        every pair.
        """
        everything = GeometrySet(list(self.shapes.ids))
        context = self._diagram.scene_graph().GetMyMutableContextFromRoot(self._root)
        filters = self._diagram.scene_graph().collision_filter_manager(context)
        filters.Apply(CollisionFilterDeclaration().AllowWithin(everything))
        rows = []
        for a, b in combinations(self._solid, 2):
            pair = self._pair(a, b)
            if pair is not None:
                rows += [(i, j, len(self.pairs)) for i in self._solid[a] for j in self._solid[b]]
                self.pairs.append(pair)
        self.first, self.second, self.pair_of = np.array(rows, dtype=np.intp).T
        radius = self.shapes.radius
        self.reach = radius[self.first] + radius[self.second]

    def _pair(self, a: str, b: str) -> BodyPair | None:
        """Return the clearance of two bodies; None if there is none.

        There is none for two bodies without relative motion, for the two sides of one joint (their
        shapes overlap there), and for the two fingers of one gripper (they meet when it closes).
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

    def _side(self, name: str) -> int:
        """Return the index of the arm that a body (scoped name) belongs to, gripper included.

        -1 for none.
        """
        arm = self.cell.robot.arm_of(scoped(name)[0])
        return -1 if arm is None else arm

    def _kind(self, a: str, b: str) -> tuple[str, float, int]:
        clearance = self.cell.scenario.clearance
        robot = self.cell.robot
        sides = self._side(a), self._side(b)
        table = _name(self._table.body())
        if sides[0] >= 0 and sides[1] >= 0:
            if sides[0] != sides[1]:
                return "arm-arm", clearance.arm_arm, -1
            fingers = _element(a) in robot.fingers and _element(b) in robot.fingers
            return ("fingers" if fingers else "self"), 0.0, -1
        if table in (a, b) and max(sides) >= 0:
            body = _element(b if a == table else a)
            if body in robot.fingers:
                return "finger-table", clearance.finger_table, max(sides)
            if body == robot.palm:
                return "palm-table", clearance.palm_table, -1
            return "arm-table", clearance.arm_table, -1
        if any({a, b} == set(pair) for pair in robot.adjacent):
            return "adjacent", 0.0, -1
        return "surroundings", clearance.surroundings, -1


def _name(body: RigidBody) -> str:
    return str(body.scoped_name().get_full())


def _element(name: str) -> str:
    return scoped(name)[1]


def _axis(joint: Joint) -> Array:
    """Return the direction (3,) of a joint's axis in its child frame."""
    if isinstance(joint, PrismaticJoint):
        return np.asarray(joint.translation_axis())
    if isinstance(joint, RevoluteJoint):
        return np.asarray(joint.revolute_axis())
    raise InputError(f"joint '{joint.name()}' neither slides nor turns; use such a joint")
