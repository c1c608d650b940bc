"""A towel on the table as both eyes of the head see it, traced ray by ray, without a renderer."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.simulation.rendering.synthetic_towel import Towel
from unwrinkle.testing.table import GARMENT_CENTRE

_TEXEL = 0.0012
_SIDE = 2.0
#: Standard deviations of the texture and of the noise, grey values.
_CONTRAST = 18.0
_NOISE = 2.0
_CLOTH_BGR = (90.0, 130.0, 170.0)
_TABLE_BGR = (170.0, 140.0, 100.0)
_STEPS = 12  # of the intersection of a ray with the surface


@dataclass(frozen=True, eq=False)
class TracedPair:
    """A pair of pictures with its truth.

    Attributes:
        pair: of the left and the right eye.
        head: the nominal one.
        gaze: that they were taken at.
        towel: in them.
    """

    pair: StereoPair
    head: StereoHead
    gaze: Gaze
    towel: Towel


@cache
def traced_pair(
    towel: Towel, *, texture_seed: int = 1, noise_seed: int = 2, scale: float = 0.25
) -> TracedPair:
    """Trace the pictures of a towel, with texture and noise.

    Args:
        towel: on an endless table; the cloth's texture moves with it, the table's does not.
        texture_seed: of the texture.
        noise_seed: of the white noise.
        scale: of the pictures, 1 for the head's resolution.
    """
    head = nominal_head()
    gaze = head.gaze_at(np.array([*GARMENT_CENTRE, towel.table_height]))
    grain = _texture(texture_seed)
    rng = np.random.default_rng(noise_seed)
    images = []
    for eye, X_WC in zip((head.left, head.right), head.poses(gaze), strict=True):
        image = _traced(towel, eye.camera.scaled(scale), X_WC, grain)
        noisy = image + _NOISE * rng.standard_normal(image.shape[:2])[..., None]
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return TracedPair(StereoPair(images[0], images[1], "pair"), head, gaze, towel)


def _texture(seed: int) -> NDArray[np.float32]:
    """Random structure from one texel to some centimetres, about 0 mean and 1 deviation."""
    rng = np.random.default_rng(seed)
    count = round(_SIDE / _TEXEL)
    total = np.zeros((count, count), np.float32)
    for sigma in (1.0, 2.5, 8.0):
        noise = cv2.GaussianBlur(rng.standard_normal((count, count), np.float32), (0, 0), sigma)
        total += noise / noise.std()
    return total / total.std()


def _traced(
    towel: Towel, camera: Camera, X_WC: Pose, grain: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Return a camera's image (h, w, 3)."""
    ray_x, ray_y = camera.rays()
    rays_W = np.stack([ray_x, ray_y, np.ones_like(ray_x)], axis=-1) @ X_WC[:3, :3].T
    surface = np.full(ray_x.shape, towel.table_height)
    for _ in range(_STEPS):
        depth = (surface - X_WC[2, 3]) / rays_W[..., 2]
        x, y = (X_WC[k, 3] + depth * rays_W[..., k] for k in (0, 1))
        surface = towel.table_height + towel.height(x, y)
    cloth = towel.edge_distance(x, y) > 0.0
    middle = 0.5 * _SIDE / _TEXEL
    u, v = (
        np.where(cloth, at - of_towel, at - of_table) / _TEXEL + middle
        for at, of_towel, of_table in zip((x, y), towel.centre, GARMENT_CENTRE, strict=True)
    )
    seen = cv2.remap(
        grain,
        u.astype(np.float32),
        v.astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )
    colour = np.where(cloth[..., None], _CLOTH_BGR, _TABLE_BGR)
    return np.clip(colour + _CONTRAST * seen[..., None], 0, 255).astype(np.uint8)
