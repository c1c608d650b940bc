"""A head with moving eyes in the rendered cell, and the truth about where it looks."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Image
from unwrinkle.models.robot import load_cell
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.gaze.vergence import in_steps, ray
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.simulation.devices.pan_tilt import VirtualPanTilt
from unwrinkle.simulation.rendering.image_noise import photograph_pair
from unwrinkle.simulation.rendering.meshes import towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel

_PROBE = Camera("probe", 33, 33, 400.0, 400.0, 16.0, 16.0)


@dataclass
class HeadInCell:
    """The cell with a towel on its table, its head, and the units that turn its eyes.

    Attributes:
        head: as it really is.
        renderer: of the cell.
        outline: (n, 3) points on a grid over the garment, world, metres.
        surface: world z of the table, metres.
        units: left and right.
        seed: of the noise of the next pair.
        quality: samples per pixel along either axis; small images alias with one.
        target: (3,) point whose angles off the axes are noted at each look, world.
        offsets: those angles (left, right), one pair per look, radians.
        times: seconds of computing between a pair handed over and the next one asked for.
    """

    head: StereoHead
    renderer: Renderer
    outline: NDArray[np.float64]
    surface: float
    units: tuple[VirtualPanTilt, VirtualPanTilt]
    seed: int
    quality: int = 1
    target: NDArray[np.float64] | None = None
    offsets: list[tuple[float, float]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    _handed_over: float | None = None

    @staticmethod
    def of(kind: str, seed: int, *, scale: float = 1.0) -> HeadInCell:
        """Build the cell with a towel of a kind of cloth; scale is that of the cameras' images."""
        head, towel = nominal_head(), wrinkled_towel(seed)
        if scale != 1.0:
            left_eye, right_eye = (
                replace(eye, camera=eye.camera.scaled(scale)) for eye in (head.left, head.right)
            )
            head = replace(head, left=left_eye, right=right_eye)
        steps = np.linspace(-0.5, 0.5, 21) * towel.side
        x, y = (values.ravel() for values in np.meshgrid(steps, steps))
        x, y = x + towel.centre[0], y + towel.centre[1]
        left, right = (
            VirtualPanTilt(eye.unit.step, eye.unit.pan, eye.unit.tilt, seed=int(own))
            for eye, own in zip(
                (head.left, head.right), np.random.SeedSequence(seed).generate_state(2), strict=True
            )
        )
        return HeadInCell(
            head=head,
            renderer=Renderer(load_cell(), [towel_mesh(towel, kind)]),
            outline=np.stack([x, y, np.full_like(x, towel.table_height)], axis=-1),
            surface=towel.table_height,
            units=(left, right),
            seed=1000 * seed,
            quality=1 if scale > 0.5 else 2,
        )

    @property
    def true_gaze(self) -> Gaze:
        """Where the units really stand."""
        return Gaze(*self.units[0].true_angles, *self.units[1].true_angles)

    def begin(self, target: NDArray[np.float64] | None) -> None:
        """Start a new series of looks at a point (3,) of the world."""
        self.target, self._handed_over = target, None
        self.offsets, self.times = [], []

    def take(self, wanted: Gaze) -> tuple[Image, Image, Gaze]:
        """Move, photograph, and say where the units report to be; see `gaze.TakePair`."""
        self.stop_clock()
        reported: list[float] = []
        eyes = (self.head.left, self.head.right)
        for eye, unit, angles in zip(eyes, self.units, (wanted.left, wanted.right), strict=True):
            unit.move(*in_steps(eye.unit, *angles))
            reported += [unit.step * position for position in unit.position]
        gaze = self.true_gaze
        X_WL, X_WC = self.head.poses(gaze)
        self.renderer.set_posture(head=np.array([*gaze.left, *gaze.right]))
        cameras = (self.head.left.camera, X_WL, self.head.right.camera, X_WC)
        left, right = photograph_pair(self.renderer, cameras, self.seed, quality=self.quality)
        self.seed += 1
        if self.target is not None:
            self.offsets.append(self.off_axis(self.target))
        self._handed_over = time.perf_counter()
        return left, right, Gaze(*reported)

    def stop_clock(self) -> None:
        """Note the time since the last pair was handed over; once per pair."""
        if self._handed_over is not None:
            self.times.append(time.perf_counter() - self._handed_over)
            self._handed_over = None

    def off_axis(self, p_W: NDArray[np.float64]) -> tuple[float, float]:
        """True angles between the eyes' optical axes and a point (3,) of the world, radians."""
        left, right = (
            math.atan2(float(np.hypot(x, y)), float(z))
            for x, y, z in (
                transformed(inverse(X_WC), p_W) for X_WC in self.head.poses(self.true_gaze)
            )
        )
        return left, right

    def point_at(self, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Point (3,) of the world that a pixel (2,) of the left eye shows, by exact depth."""
        X_WL, _ = self.head.poses(self.true_gaze)
        direction = ray(self.head.left.camera, pixel)
        # A probe's middle pixel looks along the ray itself: nothing is interpolated.
        turned, _ = Rotation.align_vectors([direction], [[0.0, 0.0, 1.0]])
        X_WP = X_WL.copy()
        X_WP[:3, :3] = X_WL[:3, :3] @ turned.as_matrix()
        depth = float(self.renderer.depth(_PROBE, X_WP)[16, 16])
        return np.asarray(transformed(X_WP, np.array([0.0, 0.0, depth])))

    def shares_seen(self, gaze: Gaze) -> tuple[float, float]:
        """Shares of the garment in the left and the right image at a gaze."""
        shares = []
        eyes = (self.head.left, self.head.right)
        for eye, X_WC in zip(eyes, self.head.poses(gaze), strict=True):
            pixels = eye.camera.project(transformed(inverse(X_WC), self.outline))
            size = (eye.camera.width - 1, eye.camera.height - 1)
            shares.append(float(((pixels >= 0) & (pixels <= size)).all(axis=1).mean()))
        return shares[0], shares[1]

    def mask(self, gaze: Gaze) -> NDArray[np.bool_]:
        """Where the garment is in the left image at a gaze: the polygon of its outline."""
        camera = self.head.left.camera
        X_WL, _ = self.head.poses(gaze)
        pixels = camera.project(transformed(inverse(X_WL), self.outline))
        hull = cv2.convexHull(np.rint(pixels).astype(np.int32))
        mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
        cv2.fillConvexPoly(mask, np.asarray(hull), 1)
        return mask > 0
