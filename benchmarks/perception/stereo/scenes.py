"""Rendered pairs of a wrinkled towel with everything about it known.

What `bench stereo` looks at.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.robot import load_cell
from unwrinkle.models.table import Table
from unwrinkle.models.transforms import transformed
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.rectification import Rectification
from unwrinkle.simulation.rendering.image_noise import photograph_pair
from unwrinkle.simulation.rendering.meshes import height_field_mesh, rectangle_mesh, towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import Towel, wrinkled_towel
from unwrinkle.simulation.rendering.textures import cloth, wood
from unwrinkle.testing.table import TABLE

_RIM = 0.006  # the towel's rim, where it comes down to the table, is not judged
_NEAR_DISTANCE = 1.25
_NEAR_TEXEL = 0.00015  # one texel a pixel there


@dataclass(frozen=True, eq=False)
class Scene:
    """A pair with its truth.

    Attributes:
        name: of the scene.
        towel: what lies on the table.
        table: where the table is.
        head: that looks, and its angles `gaze`.
        pair: of full size, with lens and noise.
        renderer: for exact depth.
    """

    name: str
    towel: Towel
    table: Table
    head: StereoHead
    gaze: Gaze
    pair: StereoPair
    renderer: Renderer

    @cached_property
    def distance(self) -> float:
        """From the left camera to the towel's centre, metres."""
        point = np.array([*self.towel.centre, self.towel.table_height])
        return float(np.linalg.norm(point - self.head.poses(self.gaze)[0][:3, 3]))

    def truth(
        self, rectification: Rectification, X_WC: Pose
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """True disparity of the rectified left image, where it shows cloth, metres of height per
        pixel.

        Each (h, w). Depth is rendered in the rectified camera itself, so nothing is interpolated.
        """
        depth = self.renderer.depth(rectification.camera, X_WC).astype(float)
        seen = depth > 0.0
        safe = np.where(seen, depth, 1.0)
        x, y = rectification.camera.rays()
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        points_W = transformed(X_WC, rays * safe[..., None])
        inside = self.towel.edge_distance(points_W[..., 0], points_W[..., 1]) > _RIM
        above = points_W[..., 2] > self.towel.table_height - _RIM
        per_pixel = safe**2 / (rectification.camera.fx * rectification.baseline)
        per_pixel *= np.abs(rays @ X_WC[2, :3])
        return np.asarray(rectification.disparity(safe)), seen & inside & above, per_pixel

    def reduced(self, factor: float) -> StereoPair:
        """The pair as area averages."""
        if factor == 1.0:
            return self.pair
        height, width = self.pair.left.shape[:2]
        size = (round(width * factor), round(height * factor))

        def smaller(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
            return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)

        return StereoPair(
            smaller(self.pair.left), smaller(self.pair.right), f"{self.name} x {factor}"
        )


def cell_scene(kind: str, seed: int) -> Scene:
    """The towel on the working table, seen in the whole cell by the head at home posture."""
    towel = wrinkled_towel(seed)
    cell = load_cell()
    renderer = Renderer(cell, [towel_mesh(towel, kind=kind)])
    return _scene(f"{kind}, 2.3 m", towel, cell.table, renderer, seed)


def near_scene(kind: str, seed: int) -> Scene:
    """The towel on a table brought up to 1.25 m before the head, along the same line of sight."""
    far = wrinkled_towel(seed)
    head = nominal_head()
    centre = np.array([*far.centre, far.table_height])
    eye = head.poses(head.gaze_at(centre))[0][:3, 3]
    place = eye + (centre - eye) * _NEAR_DISTANCE / np.linalg.norm(centre - eye)
    shift = place[:2] - far.centre
    ridges = tuple(
        dataclasses.replace(r, centre=(r.centre[0] + shift[0], r.centre[1] + shift[1]))
        for r in far.ridges
    )
    middle = (float(place[0]), float(place[1]))
    towel = dataclasses.replace(far, ridges=ridges, centre=middle, table_height=float(place[2]))
    table = Table(middle, (0.6, 0.6), float(place[2]))
    X_WT = np.eye(4)
    X_WT[:3, 3] = place
    top = rectangle_mesh("raised table", table.size, wood(table.size), X_WT)
    reach = (1.2 * towel.side, 1.2 * towel.side)
    garment = height_field_mesh(
        "garment",
        towel.height,
        cloth(kind, reach, texel=_NEAR_TEXEL, seed=seed),
        centre=middle,
        size=reach,
        table_height=towel.table_height,
        inside=towel.edge_distance,
    )
    renderer = Renderer(TABLE, [top, garment])
    return _scene(f"{kind}, 1.25 m", towel, table, renderer, seed)


def _scene(name: str, towel: Towel, table: Table, renderer: Renderer, seed: int) -> Scene:
    head = nominal_head()
    gaze = head.gaze_at(np.array([*towel.centre, towel.table_height]))
    X_WL, X_WR = head.poses(gaze)
    eyes: Any = (head.left.camera, X_WL, head.right.camera, X_WR)
    left, right = photograph_pair(renderer, eyes, seed)
    return Scene(name, towel, table, head, gaze, StereoPair(left, right, name), renderer)
