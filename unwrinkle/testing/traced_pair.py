"""A towel as both eyes of the head see it, traced ray by ray, through the system that perceives."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value

from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.station_messages import HeadImage
from unwrinkle.models.arrays import Image
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.systems.perception.stereo import StereoPerceptionSystem
from unwrinkle.testing import cells

_SCALE = 0.25
_TEXEL, _TEXELS = 0.0012, 1600


@dataclass(frozen=True, eq=False)
class SeenPair:
    """Pictures of one towel, and the gaze that they were taken at."""

    left: Image
    right: Image
    head: StereoHead
    gaze: Gaze


@cache
def seen_pair(seed: int = 0, shift: float = 0.0) -> SeenPair:
    """The towel at a quarter of the head's resolution, with texture and noise.

    Args:
        seed: of texture and noise.
        shift: the towel lies so much further along x, m.
    """
    ridge = Ridge((-0.05 + shift, -1.10), 1.3, 0.022, 0.016, 0.30)
    towel = Towel((ridge,), (shift, -1.10))
    head = nominal_calibration().stereo_head(cells.cell().limits.head)
    gaze = head.gaze_at(np.array([0.0, -1.1, 0.7]))
    rng = np.random.default_rng(seed)
    grain = np.zeros((_TEXELS, _TEXELS), np.float32)
    for sigma in (1.0, 2.5, 8.0):
        noise = cv2.GaussianBlur(rng.standard_normal(grain.shape, np.float32), (0, 0), sigma)
        grain += noise / noise.std()
    images = []
    for eye, X_WC in zip((head.left, head.right), head.poses(gaze), strict=True):
        image = _traced(towel, eye.camera.scaled(_SCALE), X_WC, 10.0 * grain, shift)
        noisy = image + 2.0 * rng.standard_normal(image.shape[:2])[..., None]
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return SeenPair(images[0], images[1], head, gaze)


def _traced(
    towel: Towel, camera: Any, X_WC: NDArray[np.float64], grain: NDArray[np.float32], shift: float
) -> NDArray[np.float64]:
    """What a camera sees of a towel on an endless table; the cloth's texture moves with it."""
    ray_x, ray_y = camera.rays()
    rays_W = np.stack([ray_x, ray_y, np.ones_like(ray_x)], axis=-1) @ X_WC[:3, :3].T
    surface = np.full(ray_x.shape, towel.table_height)
    for _ in range(12):
        depth = (surface - X_WC[2, 3]) / rays_W[..., 2]
        x, y = (X_WC[k, 3] + depth * rays_W[..., k] for k in (0, 1))
        surface = towel.table_height + towel.height(x, y)
    on = towel.edge_distance(x, y) > 0.0
    own = np.where(on, x - shift, x)
    place = [(own / _TEXEL + 0.5 * _TEXELS), ((y + 1.1) / _TEXEL + 0.5 * _TEXELS)]
    texture = cv2.remap(
        grain,
        place[0].astype(np.float32),
        place[1].astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )
    colour = np.where(on[..., None], [90.0, 130.0, 170.0], [170.0, 140.0, 100.0])
    return np.asarray(colour + texture[..., None])


def perceive(left: HeadImage, right: HeadImage) -> Perceived:
    """What the perception system makes of two pictures."""
    head = nominal_calibration().stereo_head(cells.cell().limits.head)
    system = StereoPerceptionSystem(cells.cell(), head)
    context = system.CreateDefaultContext()
    for name, image in (("left_image", left), ("right_image", right)):
        system.GetInputPort(name).FixValue(context, Value(image))
    found: Perceived = system.GetOutputPort("range_map").Eval(context)
    return found
