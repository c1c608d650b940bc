"""Render images of the cell and the cloth, with the head's cameras or the depth camera."""

import dataclasses as dc
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array, Pose
from unwrinkle.models.robot import Cell
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.stereo.head import Eye, StereoHead
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.garment_mesh import ClothMesh
from unwrinkle.simulation.depth_cameras.cameras import depth_image, load_depth_camera
from unwrinkle.simulation.rendering.image_noise import (
    SensorModel,
    photograph_pair,
    scaled_camera,
)
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import overhead_pose

#: Images of at most a quarter of the sensor's width are rendered at this multiple of their size,
#: with _SAMPLES x _SAMPLES samples per pixel: fibres that fall between samples would otherwise be
#: different noise in each image.
_OVERSIZE = 2
_SAMPLES = 2


@dataclass(frozen=True, eq=False)
class CellPosture:
    """Posture of axes (13,) and true angles of the head (4,), rad."""

    axes: Array
    head: Array


class CellPhotographer:
    """Render one cell with one cloth; the scene is built on first use."""

    def __init__(self, cell: Cell, cloth: Cloth, head: StereoHead, seed: int) -> None:
        """Prepare the rendering of a cell.

        Args:
            cell: robot and cell, with the scenario's sensor and the garment's texture.
            cloth: solver of the cloth.
            head: true stereo head.
            seed: seed of the texture.

        Raises:
            InputError: the scale does not divide the images, or the texture or depth camera is
                unknown.
        """
        self._cell, self._cloth, self._head = cell, cloth, head
        sensor, garment = cell.scenario.sensor, cell.scenario.station.garment
        small = scaled_camera(head.left.camera, sensor.scale)
        self.shape = (small.height, small.width)
        self._scale = sensor.scale
        self._model = noisier(SensorModel(), sensor.noise)
        self._mesh = ClothMesh(
            cloth.rest,
            cloth.triangles,
            cloth.material.thickness,
            texture=garment.texture,
            seed=seed,
        )
        # The nearest visible distance depends on the kind of camera.
        self._depth_camera = (
            load_depth_camera(sensor.depth_camera) if sensor.kind == "depth" else None
        )
        self._renderer: Renderer | None = None
        self._drawn: ClothState | None = None

    def pair(
        self, posture: CellPosture, state: ClothState, seed: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Render both cameras of the head: RGB images (h, w, 3) of the scenario's scale.

        A small image is made from a rendering of twice its size, with the blur and noise that
        remain after averaging the full sensor's pixels, instead of from all 16 megapixels.
        """
        renderer = self._scene(posture, state)
        left, right = self._head.left, self._head.right
        poses = [
            self._eye_pose(eye, posture, posture.head[2 * k : 2 * k + 2])
            for k, eye in enumerate((left, right))
        ]
        finer = min(1.0, _OVERSIZE * self._scale)
        eyes = tuple(scaled_camera(eye.camera, finer) for eye in (left, right))
        pictures = photograph_pair(
            renderer,
            (eyes[0], poses[0], eyes[1], poses[1]),
            seed,
            scale=self._scale / finer,
            model=averaged(self._model, finer),
            quality=_SAMPLES if finer < 1.0 else None,
        )
        return pictures

    def depth(self, posture: CellPosture, state: ClothState, seed: int) -> Capture:
        """Render the scenario's depth camera, fixed over the table."""
        assert self._depth_camera is not None
        x, y, z = self._cell.scenario.sensor.depth_camera_place
        scene = self._scene(posture, state)
        return depth_image(scene, self._depth_camera, overhead_pose(x, y, z), seed)

    def _scene(self, posture: CellPosture, state: ClothState) -> Renderer:
        if self._renderer is None:
            mesh = self._mesh.mesh(self._cloth.vertices(state))
            renderer = partial(Renderer, self._cell, [mesh])
            if self._depth_camera is not None:
                renderer = partial(renderer, near=self._depth_camera.near_plane)
            self._renderer = renderer(posture=posture.axes, head=posture.head)
        else:
            if state is not self._drawn:
                mesh = self._mesh.mesh(self._cloth.vertices(state))
                self._renderer.reshape(mesh.name, mesh)
            self._renderer.set_posture(posture.axes, posture.head)
        self._drawn = state
        return self._renderer

    def _eye_pose(self, eye: Eye, posture: CellPosture, angles: Array) -> Pose:
        """Return the true pose X_WC (4, 4) of a camera.

        Angles slightly beyond a limit are accepted.
        """
        X_WR = self._head.turntable_pose(float(posture.axes[0]))
        mount = eye.unit.mount_pose(float(angles[0]), float(angles[1]))
        return np.asarray(X_WR @ eye.X_RB @ mount @ eye.X_MC)


def noisier(model: SensorModel, factor: float) -> SensorModel:
    """Return a sensor model with `factor` times the standard deviation of the noise."""
    return dc.replace(
        model, shot_gain=model.shot_gain * factor**2, read_noise=model.read_noise * factor
    )


def averaged(model: SensorModel, scale: float) -> SensorModel:
    """Return the sensor model after averaging blocks of 1/scale x 1/scale pixels.

    The noise of a mean of n^2 pixels is n times smaller. The blur is that of the lens and of the
    block (variance 1/12 of its side), less what one rendered sample per pixel already contributes.
    """
    if scale == 1.0:
        return model
    blur = float(np.hypot(model.blur * scale, np.sqrt(1.0 / 12.0)))
    return dc.replace(
        model,
        blur=max(0.4, blur),
        shot_gain=model.shot_gain * scale**2,
        read_noise=model.read_noise * scale,
    )
