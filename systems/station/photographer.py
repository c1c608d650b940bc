"""Photographs of the cell with the cloth as it lies: by the head's cameras, or by the depth camera."""

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

# Pictures of at most a quarter of the sensor's size are photographed twice as fine as they are asked
# for, with 2 x 2 samples each: fibres that fall between samples would be another noise in each eye.
_FINER, _QUALITY = 2, 2


@dataclass(frozen=True, eq=False)
class Posture:
    """Of the robot: axes (13,) and the head's true angles (4,), rad."""

    axes: Array
    head: Array


class CellPhotographer:
    """Draws one cell with one cloth; the scene is built when it is first needed."""

    def __init__(self, cell: Cell, cloth: Cloth, head: StereoHead, seed: int) -> None:
        """Photograph a cell.

        Args:
            cell: with the scenario's sensor and the garment's texture.
            cloth: what lies on the table.
            head: the true one.
            seed: of the texture.

        Raises:
            InputError: a scale that does not divide the pictures, an unknown texture or depth camera.
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
        # Each kind of camera sees from another distance on.
        self._depth_camera = (
            load_depth_camera(sensor.depth_camera) if sensor.kind == "depth" else None
        )
        self._renderer: Renderer | None = None
        self._drawn: ClothState | None = None

    def pair(
        self, posture: Posture, state: ClothState, seed: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Photograph with both eyes: RGB pictures (h, w, 3) of the scenario's scale.

        A small picture is made from a photograph of twice its own size, with the blur and the noise
        that averaging leaves of the full sensor's, instead of from all 16 megapixels.
        """
        renderer = self._scene(posture, state)
        left, right = self._head.left, self._head.right
        poses = [
            self._eye_pose(eye, posture, posture.head[2 * k : 2 * k + 2])
            for k, eye in enumerate((left, right))
        ]
        finer = min(1.0, _FINER * self._scale)
        eyes = tuple(scaled_camera(eye.camera, finer) for eye in (left, right))
        pictures = photograph_pair(
            renderer,
            (eyes[0], poses[0], eyes[1], poses[1]),
            seed,
            scale=self._scale / finer,
            model=averaged(self._model, finer),
            quality=_QUALITY if finer < 1.0 else None,
        )
        return pictures

    def depth(self, posture: Posture, state: ClothState, seed: int) -> Capture:
        """Photograph with the scenario's depth camera, fixed over the table."""
        assert self._depth_camera is not None
        x, y, z = self._cell.scenario.sensor.depth_camera_place
        scene = self._scene(posture, state)
        return depth_image(scene, self._depth_camera, overhead_pose(x, y, z), seed)

    def _scene(self, posture: Posture, state: ClothState) -> Renderer:
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

    def _eye_pose(self, eye: Eye, posture: Posture, angles: Array) -> Pose:
        """X_WC (4, 4) where the eye truly is; a hair beyond a limit is no error here."""
        X_WR = self._head.turntable_pose(float(posture.axes[0]))
        mount = eye.unit.mount_pose(float(angles[0]), float(angles[1]))
        return np.asarray(X_WR @ eye.X_RB @ mount @ eye.X_MC)


def noisier(model: SensorModel, factor: float) -> SensorModel:
    """A sensor with so many times the noise, by standard deviation; all else alike."""
    return dc.replace(
        model, shot_gain=model.shot_gain * factor**2, read_noise=model.read_noise * factor
    )


def averaged(model: SensorModel, scale: float) -> SensorModel:
    """Blur and noise of a sensor's pictures after averaging over blocks of 1/scale x 1/scale pixels.

    The noise of a mean of n^2 pixels is n times smaller. The blur is that of the lens and of the
    block (variance 1/12 of its side), as far as drawing one sample per pixel does not bring it in.
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
