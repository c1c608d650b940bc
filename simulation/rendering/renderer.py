"""Colour and exact depth images of the cell, rendered by Drake for ideal pinhole cameras.

Drake's pixel coordinates start at the top left CORNER of the image, this project's (as OpenCV's) at
the CENTRE of the top left pixel; `drake_camera` is the only place that converts them.
"""

import dataclasses as dc
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
    InMemoryMesh,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    QueryObject,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    Role,
)
from pydrake.math import RigidTransform
from pydrake.planning import RobotDiagram, RobotDiagramBuilder
from pydrake.systems.sensors import CameraInfo

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, add_cell, position_indices, scoped
from unwrinkle.models.table import Table
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.rendering.meshes import TexturedMesh, rectangle_mesh
from unwrinkle.simulation.rendering.textures import wood

_RENDERER = "vtk"
#: Near clipping plane, metres: beyond the lens body, which is in front of its optical centre.
_NEAR_M = 0.40

#: Far clipping plane, metres.
_FAR_M = 8.0

#: Thickness of the table's slab, metres.
_TABLE_THICKNESS_M = 0.15

#: Limit of the pixels rendered at once; more need gigabytes of memory.
_MAX_PIXELS = 20_000_000

#: Distance of the slab's top below the textured one, metres.
_SLAB_OFFSET_M = 0.001


@dataclass(frozen=True)
class Light:
    """Directional light, fixed in the world.

    Attributes:
        direction: of its rays.
        intensity: 1 shows a perpendicular surface in its own colours.
    """

    direction: tuple[float, float, float]
    intensity: float


#: Lights from either side, and a weak one from behind the robot. A light at the camera would shade
#: the eyes differently; lights straight above would not show the ridges.
LIGHTS = (
    Light((0.60, 0.30, -0.75), 0.75),
    Light((-0.75, 0.15, -0.60), 0.30),
    Light((0.05, -0.90, -0.45), 0.25),
)


def drake_camera(camera: Camera) -> CameraInfo:
    """Return Drake's intrinsics of a pinhole camera; distortion is ignored.

    Drake's principal point is half a pixel further along both axes, because it counts from the top
    left corner of the image. Measured on a wavy cloth at 0.9 m: depth back-projects to the surface
    within 1.5 micrometres RMS, without the half pixel within 320 micrometres.

    Raises:
        InputError: the principal point is outside the image, which Drake does not support.
    """
    cx, cy = camera.cx + 0.5, camera.cy + 0.5
    if not (0.0 < cx < camera.width and 0.0 < cy < camera.height):
        raise InputError(
            f"camera {camera.name!r}: principal point ({camera.cx:.1f}, {camera.cy:.1f}) is "
            f"outside the image of {camera.width} x {camera.height}; the renderer cannot do that"
        )
    return CameraInfo(
        width=camera.width,
        height=camera.height,
        focal_x=camera.fx,
        focal_y=camera.fy,
        center_x=cx,
        center_y=cy,
    )


class Renderer:
    """Renderer of a scene: the cell, or the working table alone, with textured items.

    The robot's posture and the items' poses can be changed; images are rendered on demand.
    """

    def __init__(
        self,
        place: Cell | Table,
        items: Sequence[TexturedMesh] = (),
        *,
        lights: Sequence[Light] = LIGHTS,
        posture: NDArray[np.floating[Any]] | None = None,
        head: NDArray[np.floating[Any]] | None = None,
        shadows: bool = False,
        near: float = _NEAR_M,
    ) -> None:
        """Build the scene (one to two seconds for a fine mesh).

        Args:
            place: the robot's cell, or a working table alone.
            items: meshes in the scene, with unique names.
            lights: fixed in the world.
            posture: (13,) turn-table, right arm, left arm, radians; None for home (zeros).
            head: (4,) left pan, left tilt, right pan, right tilt, radians; None for the cell's
                gaze.
            shadows: render shadows (slower).
            near: near clipping plane, metres.

        Raises:
            InputError: two items share a name, or a posture has the wrong shape.
        """
        cell = self._cell = place if isinstance(place, Cell) else None
        self._near = near
        builder = RobotDiagramBuilder(time_step=0.0)
        plant, scene_graph = builder.plant(), builder.scene_graph()
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(_engine(lights, shadows)))
        if cell is not None:
            add_cell(cell, plant, builder.parser())
        plant.Finalize()
        source = self._source = scene_graph.RegisterSource("items")
        self._frames: dict[str, FrameId] = {}
        self._poses: dict[str, RigidTransform] = {}
        self._shapes: dict[str, GeometryId] = {}
        if cell is not None:
            _hide_table(cell, plant, scene_graph)
        _add_table(scene_graph, source, place.table if isinstance(place, Cell) else place)
        for item in items:
            if item.name in self._frames:
                raise InputError(f"scene: two items are called {item.name!r}; name them apart")
            frame = scene_graph.RegisterFrame(source, GeometryFrame(item.name))
            shape = _geometry(item, RigidTransform())
            self._shapes[item.name] = scene_graph.RegisterGeometry(source, frame, shape)
            self._frames[item.name] = frame
            self._poses[item.name] = _transform(item.X_WM)
        port = scene_graph.get_source_pose_port(source)
        builder.builder().ExportInput(port, "items")
        self._diagram = cast(RobotDiagram, builder.Build())
        self._context = self._diagram.CreateDefaultContext()
        self._world = scene_graph.world_frame_id()
        self._fix_poses()
        if cell is not None:
            self.set_posture(posture, head)

    def set_posture(
        self,
        posture: NDArray[np.floating[Any]] | None = None,
        head: NDArray[np.floating[Any]] | None = None,
    ) -> None:
        """Set the posture (13,) and the head angles (4,), radians.

        Without a posture the robot is at home; without head angles the head keeps its own.

        Raises:
            InputError: the scene has no robot, or a shape is wrong.
        """
        if self._cell is None:
            raise InputError("scene: it has no robot whose posture could be set")
        plant = self._diagram.plant()
        context = plant.GetMyMutableContextFromRoot(self._context)
        indices = position_indices(self._cell, plant)
        q = plant.GetPositions(context).copy()
        q[indices.axes] = 0.0 if posture is None else _vector(posture, 13, "posture")
        if head is not None:
            q[indices.head] = _vector(head, 4, "head")
        plant.SetPositions(context, q)

    def move(self, name: str, X_WM: Pose) -> None:
        """Move an item to a pose (4, 4).

        Raises:
            InputError: there is no item of that name.
        """
        if name not in self._poses:
            raise InputError(f"scene: no item {name!r}; it has {', '.join(self._poses) or 'none'}")
        self._poses[name] = _transform(X_WM)
        self._fix_poses()

    def reshape(self, name: str, mesh: TexturedMesh) -> None:
        """Replace an item's mesh, with its texture and pose, for example of cloth that moved.

        Raises:
            InputError: there is no item of that name.
        """
        self.move(name, mesh.X_WM)
        scene_graph = self._diagram.scene_graph()
        context = scene_graph.GetMyMutableContextFromRoot(self._context)
        shape = _geometry(mesh, RigidTransform()).shape()
        scene_graph.ChangeShape(context, self._source, self._shapes[name], shape)

    def colour(self, camera: Camera, X_WC: Pose, *, quality: int = 1) -> NDArray[np.uint8]:
        """Render a colour image (h, w, 3) uint8 RGB, without distortion, blur or noise.

        Args:
            camera: intrinsics; distortion is ignored.
            X_WC: (4, 4) pose of the camera.
            quality: n for n x n averaged samples per pixel, which take n x n times as long. One
                sample is neither sharp nor free of aliasing, because the renderer smooths edges
                (FXAA) and fine texture. On terry at 1 to 1.3 texels per pixel one sample is 4 to 5
                grey levels (RMS) from the mean over the pixel's area, 2 x 2 samples are 1.2 to 1.5.

        Raises:
            InputError: quality is below 1 or above 8.
        """
        if not 1 <= quality <= 8:
            raise InputError(f"rendering: quality {quality}, wanted 1 to 8")
        if quality == 1:
            return np.ascontiguousarray(self._drawn(camera, X_WC))
        result = np.empty((camera.height, camera.width, 3), dtype=np.uint8)
        for window, part in _parts(camera, quality):
            size = (part.width, part.height)
            large = self._drawn(part.scaled(float(quality)), X_WC)
            result[window] = cv2.resize(large, size, interpolation=cv2.INTER_AREA)
        return result

    def depth(self, camera: Camera, X_WC: Pose) -> NDArray[np.float32]:
        """Render the exact depth (h, w) of the meshes along the camera's z, metres; 0 for none."""
        wide, window = _containing(camera)
        core = self._core(wide)
        drawn = self._query().RenderDepthImage(
            DepthRenderCamera(core, DepthRange(self._near * 1.001, _FAR_M * 0.999)),
            self._world,
            _transform(X_WC),
        )
        depth = np.asarray(drawn.data)[..., 0][window]
        return np.where(np.isfinite(depth), depth, np.float32(0.0))

    def _drawn(self, camera: Camera, X_WC: Pose) -> NDArray[np.uint8]:
        wide, window = _containing(camera)
        drawn = self._query().RenderColorImage(
            ColorRenderCamera(self._core(wide)), self._world, _transform(X_WC)
        )
        return np.asarray(drawn.data)[(*window, slice(3))]

    def _core(self, camera: Camera) -> RenderCameraCore:
        return RenderCameraCore(
            _RENDERER, drake_camera(camera), ClippingRange(self._near, _FAR_M), RigidTransform()
        )

    def _query(self) -> QueryObject:
        scene_graph = self._diagram.scene_graph()
        context = scene_graph.GetMyContextFromRoot(self._context)
        return scene_graph.get_query_output_port().Eval(context)

    def _fix_poses(self) -> None:
        poses = FramePoseVector()
        for name, frame in self._frames.items():
            poses.set_value(frame, self._poses[name])
        self._diagram.GetInputPort("items").FixValue(self._context, poses)


def _engine(lights: Sequence[Light], shadows: bool) -> RenderEngineVtkParams:
    return RenderEngineVtkParams(
        lights=[
            LightParameter(
                type="directional",
                color=Rgba(1.0, 1.0, 1.0),
                intensity=light.intensity,
                direction=list(light.direction),
                frame="world",
            )
            for light in lights
        ],
        cast_shadows=shadows,
        shadow_map_size=2048,
        default_clear_color=np.array([0.25, 0.26, 0.28]),
    )


def _parts(camera: Camera, quality: int) -> list[tuple[tuple[slice, slice], Camera]]:
    """Split an image into windows with their cameras, to limit the renderer's memory.

    They meet at the principal point, which Drake requires inside the image.
    """
    columns, rows = [0, camera.width], [0, camera.height]
    if quality * quality * camera.width * camera.height > _MAX_PIXELS:
        for ends, centre in ((columns, camera.cx), (rows, camera.cy)):
            middle = round(centre)
            if 0.25 * ends[-1] < middle < 0.75 * ends[-1]:
                ends.insert(1, middle)
    parts = []
    for top, below in pairwise(rows):
        for left, right in pairwise(columns):
            part = dc.replace(
                camera,
                width=right - left,
                height=below - top,
                cx=camera.cx - left,
                cy=camera.cy - top,
            )
            parts.append(((slice(top, below), slice(left, right)), part))
    return parts


def _containing(camera: Camera) -> tuple[Camera, tuple[slice, slice]]:
    """Return a camera with the principal point inside its image, and the requested window."""
    left, top = (max(0, int(np.ceil(1.0 - c))) for c in (camera.cx, camera.cy))
    right = max(0, int(np.ceil(camera.cx + 1.0)) - camera.width)
    below = max(0, int(np.ceil(camera.cy + 1.0)) - camera.height)
    window = (slice(top, top + camera.height), slice(left, left + camera.width))
    if not (left or top or right or below):
        return camera, window
    wide = dc.replace(
        camera,
        width=camera.width + left + right,
        height=camera.height + top + below,
        cx=camera.cx + left,
        cy=camera.cy + top,
    )
    return wide, window


def _geometry(item: TexturedMesh, X_FM: RigidTransform) -> GeometryInstance:
    material = b"newmtl cloth\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nmap_Kd cloth.png\n"  # Phong, no gloss
    mesh = InMemoryMesh(
        mesh_file=MemoryFile(item.obj("cloth.mtl"), ".obj", item.name),
        supporting_files={
            "cloth.mtl": MemoryFile(material, ".mtl", "cloth.mtl"),
            "cloth.png": MemoryFile(item.texture.png, ".png", "cloth.png"),
        },
    )
    return _seen(GeometryInstance(X_FM, Mesh(mesh), item.name))


def _seen(instance: GeometryInstance, colour: Rgba | None = None) -> GeometryInstance:
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel.kDontCare)
    if colour is not None:
        properties.AddProperty("phong", "diffuse", colour)
    instance.set_perception_properties(properties)
    return instance


def _hide_table(cell: Cell, plant: Any, scene_graph: Any) -> None:
    """Hide the cell's table slab, which would show through the textured top."""
    instance, name = scoped(cell.scenario.table.frame)
    body = plant.GetFrameByName(name, plant.GetModelInstanceByName(instance)).body()
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetGeometries(frame, Role.kPerception):
        shape = inspector.GetShape(geometry)
        if isinstance(shape, Box) and np.allclose(shape.size()[:2], cell.table.size):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)


def _add_table(scene_graph: Any, source: Any, table: Table) -> None:
    X_WT = np.eye(4)
    X_WT[:3, 3] = table.top_centre
    top = rectangle_mesh("table top", table.size, wood(table.size))
    scene_graph.RegisterAnchoredGeometry(source, _geometry(top, _transform(X_WT)))
    thickness = _TABLE_THICKNESS_M - _SLAB_OFFSET_M
    X_WT[2, 3] -= _SLAB_OFFSET_M + 0.5 * thickness
    slab = GeometryInstance(_transform(X_WT), Box(*table.size, thickness), "table slab")
    scene_graph.RegisterAnchoredGeometry(source, _seen(slab, Rgba(0.55, 0.45, 0.33)))


def _transform(X: Pose) -> RigidTransform:
    return RigidTransform(np.asarray(X, dtype=float))


def _vector(values: Any, size: int, name: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=float)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"scene: {name} {array.shape} must be ({size},), finite, in radians")
    return array
