"""The cell's bodies as other viewers show them: simple shapes, and poses along a motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, position_indices

#: Kind, pose in the geometry's frame, and extents of a part of a shape.
_Part = tuple[str, Array, tuple[float, float, float]]
#: Colour of a shape without one, RGBA.
_GREY = (0.6, 0.6, 0.6, 1.0)


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A shape on a body.

    Attributes:
        kind: `box`, `cylinder` (along z) or `ellipsoid`.
        X_BG: pose (4, 4) of the shape in the body's frame, m.
        size: (3,) extents along x, y, z, m.
        colour: (4,) red, green, blue, opacity, 0 to 1.
    """

    kind: str
    X_BG: Array
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]

    @property
    def quaternion(self) -> Array:
        """Turn of the shape in the body's frame: quaternion x, y, z, w."""
        return quaternion(self.X_BG)


class CellBodies:
    """Bodies of a cell with their shapes and their poses.

    Attributes:
        names: scoped names of the bodies that have a shape.
        bodies: the same bodies in the cell's plant.
        shapes: of each body, in the order of `names`.
        moving: (B,) whether the robot moves the body.
    """

    def __init__(self, cell: Cell, role: Role = Role.kIllustration) -> None:
        """Collect the shapes; one that is neither box, cylinder, sphere, capsule nor ellipsoid is
        replaced by the smallest box around it.

        Args:
            cell: the cell.
            role: shapes that are displayed, or those of the collision checks.
        """
        self.plant = cell.diagram.plant()
        self.context = self.plant.CreateDefaultContext()
        self._indices = position_indices(cell, self.plant)
        inspector = cell.diagram.scene_graph().model_inspector()
        self.names: list[str] = []
        self.shapes: list[list[BodyShape]] = []
        self.bodies = []
        for index in map(BodyIndex, range(self.plant.num_bodies())):
            body = self.plant.get_body(index)
            name = str(body.scoped_name().get_full())
            frame = self.plant.GetBodyFrameIdOrThrow(index)
            found: list[BodyShape] = []
            for geometry in inspector.GetGeometries(frame, role):
                X_BG = inspector.GetPoseInFrame(geometry).GetAsMatrix4()
                parts = _parts(inspector.GetShape(geometry))
                box = None if parts else inspector.GetObbInGeometryFrame(geometry)
                if box is not None:
                    X_GO = box.pose().GetAsMatrix4()
                    a, b, c = map(float, box.half_width())
                    parts = [("box", X_GO, (2.0 * a, 2.0 * b, 2.0 * c))]
                colour = _colour(inspector, geometry)
                found += [BodyShape(kind, X_BG @ X, size, colour) for kind, X, size in parts]
            if found:
                self.names.append(name)
                self.shapes.append(found)
                self.bodies.append(body)
        anchored = [self.plant.IsAnchored(body) for body in self.bodies]
        self.moving: NDArray[np.bool_] = ~np.array(anchored)

    @property
    def columns(self) -> NDArray[np.intp]:
        """Positions in the plant's vector of the axes (13) and the grippers (2)."""
        return np.concatenate([self._indices.axes, self._indices.grippers])

    def poses(self, positions: Array, openings: Array) -> Array:
        """Compute the bodies' poses in the world.

        Args:
            positions: (13,) of the axes, rad.
            openings: (2,) of the grippers, m.

        Returns:
            (B, 7) place in m, and quaternion x, y, z, w.
        """
        q = self.plant.GetPositions(self.context)
        q[self._indices.axes] = positions
        q[self._indices.grippers] = openings
        self.plant.SetPositions(self.context, q)
        found = np.empty((len(self.bodies), 7))
        for row, body in zip(found, self.bodies, strict=True):
            X_WB = self.plant.EvalBodyPoseInWorld(self.context, body)
            row[:3], row[3:] = X_WB.translation(), quaternion(X_WB.GetAsMatrix4())
        return found


def quaternion(X: Array) -> Array:
    """Return the quaternion x, y, z, w of a pose (4, 4)."""
    w, x, y, z = RigidTransform(X).rotation().ToQuaternion().wxyz()
    return np.array([x, y, z, w])


def _colour(
    inspector: SceneGraphInspector, geometry: GeometryId
) -> tuple[float, float, float, float]:
    properties = inspector.GetIllustrationProperties(geometry)
    if properties is None or not properties.HasProperty("phong", "diffuse"):
        return _GREY
    rgba: Any = properties.GetProperty("phong", "diffuse")
    return (float(rgba.r()), float(rgba.g()), float(rgba.b()), float(rgba.a()))


def _parts(shape: Shape) -> list[_Part]:
    """Split a shape into boxes, cylinders and ellipsoids; empty for a shape of another kind."""

    def part(kind: str, x: float, y: float, z: float, at: float = 0.0) -> _Part:
        X = np.eye(4)
        X[2, 3] = at
        return kind, X, (x, y, z)

    if isinstance(shape, Box):
        return [part("box", shape.width(), shape.depth(), shape.height())]
    if isinstance(shape, Cylinder):
        return [part("cylinder", 2.0 * shape.radius(), 2.0 * shape.radius(), shape.length())]
    if isinstance(shape, Sphere):
        return [part("ellipsoid", *3 * (2.0 * shape.radius(),))]
    if isinstance(shape, Ellipsoid):
        return [part("ellipsoid", 2.0 * shape.a(), 2.0 * shape.b(), 2.0 * shape.c())]
    if isinstance(shape, Capsule):
        d, half = 2.0 * shape.radius(), 0.5 * shape.length()
        ends = [part("ellipsoid", d, d, d, z) for z in (-half, half)]
        return [part("cylinder", d, d, shape.length()), *ends]
    return []
