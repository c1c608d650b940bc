"""Fixture: ray-traced stereo pair of a towel on the table, without a renderer."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel

_TEXEL = 0.0012
_SIDE = 2.0


@dataclass(frozen=True, eq=False)
class SeenTowel:
    """An image pair with its ground truth."""

    pair: StereoPair
    head: StereoHead
    gaze: Gaze
    towel: Towel


def _textures(seed: int) -> NDArray[np.float32]:
    """Random structure from one texel to some centimetres, about 0 mean and 1 deviation."""
    rng = np.random.default_rng(seed)
    count = round(_SIDE / _TEXEL)
    total = np.zeros((count, count), np.float32)
    for sigma in (1.0, 2.5, 8.0):
        noise = cv2.GaussianBlur(rng.standard_normal((count, count), np.float32), (0, 0), sigma)
        total += noise / noise.std()
    return total / total.std()


def traced(
    towel: Towel, camera: Camera, X_WC: NDArray[np.float64], texture: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Return a camera's image (h, w, 3) uint8 of a towel on an infinite table."""
    ray_x, ray_y = camera.rays()
    rays_W = np.stack([ray_x, ray_y, np.ones_like(ray_x)], axis=-1) @ X_WC[:3, :3].T
    surface = np.full(ray_x.shape, towel.table_height)
    for _ in range(12):
        depth = (surface - X_WC[2, 3]) / rays_W[..., 2]
        x, y = (X_WC[k, 3] + depth * rays_W[..., k] for k in (0, 1))
        surface = towel.table_height + towel.height(x, y)
    middle = 0.5 * _SIDE / _TEXEL
    u = (x - towel.centre[0]) / _TEXEL + middle
    v = (y - towel.centre[1]) / _TEXEL + middle
    grain = cv2.remap(
        texture,
        u.astype(np.float32),
        v.astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )
    colour = np.where(
        (towel.edge_distance(x, y) > 0.0)[..., None], [90.0, 130.0, 170.0], [170.0, 140.0, 100.0]
    )
    return np.asarray(np.clip(colour + 18.0 * grain[..., None], 0, 255), dtype=np.uint8)


@pytest.fixture(scope="session")
def seen_towel() -> SeenTowel:
    """A towel with two ridges, seen by the head at a quarter of its resolution, with noise."""
    towel = Towel(
        ridges=(
            Ridge((-0.05, -1.10), 1.3, 0.022, 0.016, 0.30),
            Ridge((0.12, -1.12), 1.8, 0.018, 0.014, 0.20),
        )
    )
    head = nominal_head()
    gaze = head.gaze_at(np.array([0.0, -1.1, 0.7]))
    texture = _textures(1)
    rng = np.random.default_rng(2)
    images = []
    for eye, X_WC in zip((head.left, head.right), head.poses(gaze), strict=True):
        image = traced(towel, eye.camera.scaled(0.25), X_WC, texture)
        noisy = image + 2.0 * rng.standard_normal(image.shape[:2])[..., None]
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return SeenTowel(StereoPair(images[0], images[1], "pair"), head, gaze, towel)
