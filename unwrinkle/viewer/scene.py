"""Show the cell in a Meshcat scene: its bodies and the shapes of the collision checks."""

import logging
import time as clock
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    Role,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.planning import RobotDiagram, RobotDiagramBuilder

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, add_cell, position_indices

#: Vertical field of view of the camera, degrees.
FIELD_OF_VIEW = 42.0
ILLUSTRATION = "illustration"
PROXIMITY = "proximity"
View = tuple[tuple[float, float, float], tuple[float, float, float]]
#: Position and target of the camera in the first view: in front of the robot, to its left; world
#: frame, m.
OVERVIEW: View = ((0.62, -3.30, 2.45), (-0.15, -0.80, 0.97))
#: View of the whole robot with its head.
WHOLE_CELL: View = ((1.6, -4.3, 2.7), (0.0, -0.35, 1.12))
#: Polling period of the controls, s.
_POLL_PERIOD = 1.0 / 30.0
_PROXIMITY_COLOUR = (0.9, 0.1, 0.1, 0.25)


def start_meshcat(host: str = "localhost", port: int | None = None) -> Any:
    """Start a Meshcat server with the project's background and first view.

    Args:
        host: address to listen on; "*" for all.
        port: port; None for the first free one from 7000.

    Raises:
        InputError: it cannot listen there.
    """
    drake = logging.getLogger("drake")
    if drake.getEffectiveLevel() < logging.INFO:
        # Meshcat's server thread logs its end at DEBUG through Python while its destructor waits
        # for that thread and may hold the interpreter's lock: a deadlock.
        drake.setLevel(logging.INFO)
    params = MeshcatParams()
    params.host, params.port, params.show_stats_plot = host, port, False
    try:
        meshcat = Meshcat(params)
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"the viewer cannot listen on {host}, port {port or '7000 and up'}: {error}; try "
            "another --port"
        ) from None
    meshcat.SetProperty("/Background/<object>", "top_color", [0.94, 0.96, 0.98])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.70, 0.75, 0.80])
    # Primitives have large plain faces: without more ambient light the shaded ones look black.
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.8)
    meshcat.SetProperty("/Lights/FillLight/<object>", "intensity", 0.7)
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    camera = Meshcat.PerspectiveCamera()
    camera.fov = FIELD_OF_VIEW
    meshcat.SetCamera(camera)
    look(meshcat, OVERVIEW)
    return meshcat


def look(meshcat: Any, view: View) -> None:
    """Place the camera; `view` is its position and its target, world frame, m."""
    meshcat.SetCameraPose(*(np.array(point) for point in view))


def in_first_view(across: float, up: float, depth: float) -> RigidTransform:
    """Return a pose facing the first view's camera.

    `across` and `up` are shares (-1..1) of a 16:10 picture, `depth` is in m.
    """
    camera, target = (np.array(point) for point in OVERVIEW)
    y = (target - camera) / np.linalg.norm(target - camera)
    x = np.cross(y, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    z = np.cross(x, y)
    half = depth * np.tan(0.5 * np.radians(FIELD_OF_VIEW))
    place = camera + depth * y + half * (1.6 * across * x + up * z)
    return RigidTransform(RotationMatrix(np.column_stack([x, y, z])), place)


def rgba(colour: str) -> Rgba:
    """Convert #rrggbb to Drake's colour."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return Rgba(red, green, blue, 1.0)


def follow(
    update: Callable[[float], object], stop: Callable[[], bool], ended: Callable[[], None]
) -> None:
    """Update a view about 30 times per second until `stop()` is true or Ctrl-C is pressed.

    Args:
        update: function called with the time since the last call, s.
        stop: function called before each update.
        ended: function called if Ctrl-C ended it.
    """
    before = clock.perf_counter()
    try:
        while not stop():
            clock.sleep(_POLL_PERIOD)
            now = clock.perf_counter()
            update(now - before)
            before = now
    except KeyboardInterrupt:
        ended()


class CellScene:
    """A cell in a Meshcat, in two layers: `illustration` and `proximity` (red, transparent)."""

    def __init__(
        self,
        cell: Cell,
        meshcat: Any,
        *,
        proximity: bool = True,
        proximity_visible: bool = False,
    ) -> None:
        """Send the cell's geometry, with the robot in its default posture.

        Args:
            cell: cell to show.
            meshcat: Meshcat to show it in.
            proximity: whether to add the layer of collision shapes.
            proximity_visible: whether that layer is visible.

        Raises:
            InputError: the cell's models cannot be read.
        """
        builder = RobotDiagramBuilder(time_step=0.0)
        add_cell(cell, builder.plant(), builder.parser())
        layers = [(Role.kIllustration, ILLUSTRATION, True)]
        if proximity:
            layers.append((Role.kProximity, PROXIMITY, proximity_visible))
        for role, prefix, visible in layers:
            params = MeshcatVisualizerParams()
            params.role, params.prefix, params.visible_by_default = role, prefix, visible
            params.default_color = Rgba(*_PROXIMITY_COLOUR)
            MeshcatVisualizer.AddToBuilder(
                builder.builder(), builder.scene_graph(), meshcat, params
            )
        self._diagram = cast(RobotDiagram, builder.Build())
        self.meshcat = meshcat
        self.plant = self._diagram.plant()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = self.plant.GetMyMutableContextFromRoot(self._context)
        self.indices = position_indices(cell, self.plant)
        self._tips = [
            self.plant.GetFrameByName("tcp", self.plant.GetModelInstanceByName(f"{arm}_gripper"))
            for arm in ("r1", "r2")
        ]
        self._bodies: dict[str, Any] = {}
        self._diagram.ForcedPublish(self._context)

    def move(self, axes: Array, openings: Array) -> None:
        """Set the thirteen axes (rad) and the two gripper openings (m) without publishing them."""
        q = self.plant.GetPositions(self._plant_context)
        q[self.indices.axes] = axes
        q[self.indices.grippers] = openings
        self.plant.SetPositions(self._plant_context, q)

    def positions(self) -> Array:
        """Return all positions of the plant, in its order."""
        return np.asarray(self.plant.GetPositions(self._plant_context), dtype=float)

    def set_positions(self, q: Array) -> None:
        """Set all positions of the plant, in its order, without publishing them."""
        self.plant.SetPositions(self._plant_context, q)

    def publish(self, time: float = 0.0) -> None:
        """Publish the posture; `time` (s) is its place in a recording, if there is one."""
        self._context.SetTime(time)
        self._diagram.ForcedPublish(self._context)

    def openings(self) -> Array:
        """Return the grippers' openings (2,) in the present posture, m."""
        return self.positions()[self.indices.grippers]

    def bodies(self) -> tuple[str, ...]:
        """Return the paths, within a layer, of the bodies that have a geometry."""
        inspector = self._diagram.scene_graph().model_inspector()
        found = []
        for index in map(BodyIndex, range(self.plant.num_bodies())):
            frame = self.plant.GetBodyFrameIdOrThrow(index)
            if inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration):
                found.append(inspector.GetName(frame).replace("::", "/"))
        return tuple(found)

    def body_poses(self, paths: tuple[str, ...]) -> Array:
        """Return positions (m) and quaternions x, y, z, w of bodies in the world frame, (B, 7)."""
        poses = np.empty((len(paths), 7))
        for k, path in enumerate(paths):
            X_WB = self.plant.EvalBodyPoseInWorld(self._plant_context, self._body(path))
            w, x, y, z = X_WB.rotation().ToQuaternion().wxyz()
            poses[k] = (*X_WB.translation(), x, y, z, w)
        return poses

    def tips(self) -> Array:
        """Return X_WT (2, 4, 4) of the right and the left tool in the present posture."""
        poses = [frame.CalcPoseInWorld(self._plant_context) for frame in self._tips]
        return np.array([pose.GetAsMatrix4() for pose in poses])

    def _body(self, path: str) -> Any:
        if path not in self._bodies:
            instance, _, name = path.rpartition("/")
            model = self.plant.GetModelInstanceByName(instance.replace("/", "::"))
            self._bodies[path] = self.plant.GetBodyByName(name, model)
        return self._bodies[path]
