"""How far any point of the robot moves per radian of each axis, computed from the model files.

The lengths are upper bounds over every configuration. What a joint carries is covered by balls: one
about the joint's origin for the shapes of its own link, and one for each joint further out. When a
joint turns, a ball whose centre lies on its axis stays where it is; any other is covered by a
larger ball about the joint's origin.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeGuard

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Role, SceneGraphInspector, Shape, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Joint,
    JointIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
)

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, scoped

#: A point nearer to an axis than this lies on it, m.
_ON_AXIS = 1e-9


@dataclass
class _Link:
    """The bodies that one axis carries, up to the next axes; its frame F is the child frame of the
    joint.

    Attributes:
        axis_F: (3,) unit direction of the axis, through the origin.
        radius: of a ball about the origin that contains the link's shapes, m.
        off_axis: greatest distance of the link's shapes from the axis, m.
        next: links that this one carries, each with the origin (3,) and the direction (3,) of its
            axis in F.
    """

    axis_F: Array
    radius: float = 0.0
    off_axis: float = 0.0
    next: list[tuple["_Link", Array, Array]] = field(default_factory=list)

    def balls(self) -> list[tuple[Array, float]]:
        """Cover everything beyond this link by balls that are fixed in F.

        Centre (3,) and radius, m.
        """
        found = []
        for link, p_F, axis_F in self.next:
            found.append((p_F, link.radius))
            for centre, radius in link.balls():
                if _distance(centre, link.axis_F) < _ON_AXIS:
                    found.append((p_F + float(centre @ link.axis_F) * axis_F, radius))
                else:
                    found.append((p_F, float(np.linalg.norm(centre)) + radius))
        return found

    def reach(self) -> float:
        """Bound the distance between the axis and any shape that it moves, m."""
        most = self.off_axis
        for link, p_F, axis_F in self.next:
            away = float(_distance(p_F, self.axis_F))
            sine = float(np.linalg.norm(np.cross(self.axis_F, axis_F)))
            most = max(most, away + link.radius)
            for centre, radius in link.balls():
                off = float(_distance(centre, link.axis_F))
                if off < _ON_AXIS:
                    fixed = p_F + float(centre @ link.axis_F) * axis_F
                    most = max(most, float(_distance(fixed, self.axis_F)) + radius)
                else:
                    # The centre circles about the next axis, which leans against this one by a
                    # fixed angle.
                    length = float(np.linalg.norm(centre))
                    most = max(most, away + min(length, length * sine + off) + radius)
        return most


def axis_reach(cell: Cell) -> Array:
    """Bound how far any point of the robot moves per radian of each axis, m.

    Args:
        cell: the robot in its cell; the head is taken as resting.

    Returns:
        (axes,) for each axis an upper bound, over all configurations, of the distance between the
        axis and any collision shape that it moves, blades at full stroke included.
    """
    links = _LinkBuilder(cell)
    return np.array([links.link(name).reach() for name in cell.robot.axes])


class _LinkBuilder:
    """Builds links from the plant of a cell."""

    def __init__(self, cell: Cell) -> None:
        diagram = cell.diagram
        self._plant: MultibodyPlant = diagram.plant()
        self._inspector: SceneGraphInspector = diagram.scene_graph().model_inspector()
        self._context = self._plant.CreateDefaultContext()
        self._axes = set(cell.robot.axes)
        self._stroke = cell.limits.gripper.stroke
        self._links: dict[JointIndex, _Link] = {}
        self._outboard: dict[BodyIndex, list[Joint]] = {}
        for index in self._plant.GetJointIndices():
            joint = self._plant.get_joint(index)
            self._outboard.setdefault(joint.parent_body().index(), []).append(joint)

    def link(self, name: str) -> _Link:
        """Build the link that an axis (scoped name) carries, with all that follows it."""
        instance, element = scoped(name)
        joint = self._plant.GetJointByName(element, self._plant.GetModelInstanceByName(instance))
        assert self._is_axis(joint)
        return self._build(joint)

    def _build(self, joint: RevoluteJoint) -> _Link:
        """Return the link of a joint, built once."""
        if joint.index() not in self._links:
            self._links[joint.index()] = self._built(joint)
        return self._links[joint.index()]

    def _built(self, joint: RevoluteJoint) -> _Link:
        link = _Link(np.asarray(joint.revolute_axis()))
        X_FW = joint.frame_on_child().CalcPoseInWorld(self._context).inverse()
        bodies = list(self._rigid(joint.child_body()))
        inner = [outboard for body in bodies for outboard in self._outboard.get(body.index(), [])]
        # The blades slide within the link: any of its shapes may be off by the stroke.
        stroke = self._stroke if any(isinstance(j, PrismaticJoint) for j in inner) else 0.0
        for body in bodies:
            X_FB = X_FW @ body.EvalPoseInWorld(self._context)
            frame = self._plant.GetBodyFrameIdOrThrow(body.index())
            for geometry in self._inspector.GetGeometries(frame, Role.kProximity):
                shape, X_BG = (
                    self._inspector.GetShape(geometry),
                    self._inspector.GetPoseInFrame(geometry),
                )
                away = np.linalg.norm(X_FB.translation()) + np.linalg.norm(X_BG.translation())
                link.radius = max(link.radius, float(away) + _shape_radius(shape) + stroke)
                points, extra = _core(shape)
                off = _distance((X_FB @ X_BG @ points.T).T, link.axis_F) + extra
                link.off_axis = max(link.off_axis, float(off.max()) + stroke)
        for outboard in inner:
            if self._is_axis(outboard):
                X_FK = X_FW @ outboard.frame_on_parent().CalcPoseInWorld(self._context)
                axis_F = X_FK.rotation() @ outboard.revolute_axis()
                link.next.append((self._build(outboard), X_FK.translation(), np.asarray(axis_F)))
        return link

    def _is_axis(self, joint: Joint) -> TypeGuard[RevoluteJoint]:
        instance = self._plant.GetModelInstanceName(joint.model_instance())
        return f"{instance}::{joint.name()}" in self._axes

    def _rigid(self, body: RigidBody) -> Iterator[RigidBody]:
        """A body and those that no further axis of the robot moves against it."""
        yield body
        for joint in self._outboard.get(body.index(), []):
            if not self._is_axis(joint):
                yield from self._rigid(joint.child_body())


def _distance(points: Array, axis: Array) -> Array:
    """Distances (...,) of points (..., 3) from the line through the origin along a unit axis."""
    return np.asarray(np.linalg.norm(np.cross(axis, points), axis=-1))


def _core(shape: Shape) -> tuple[Array, float]:
    """Points (N, 3) in a shape's frame and a distance, m.

    The shape lies in the hull of balls of that radius about them.
    """
    if isinstance(shape, Box):
        half = 0.5 * np.asarray(shape.size())
        return half * np.array(np.meshgrid(*3 * [[-1.0, 1.0]])).reshape(3, -1).T, 0.0
    if isinstance(shape, Cylinder | Capsule):
        end = 0.5 * shape.length()
        return np.array([[0.0, 0.0, -end], [0.0, 0.0, end]]), float(shape.radius())
    if isinstance(shape, Sphere):
        return np.zeros((1, 3)), float(shape.radius())
    raise TypeError(f"no bound known for the shape {type(shape).__name__}")


def _shape_radius(shape: Shape) -> float:
    """Radius of the ball about a shape's centre that contains it, m."""
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius(), 0.5 * shape.length()))
    points, radius = _core(shape)
    return radius + float(np.linalg.norm(points, axis=1).max())
