"""Analytic ground truth: a towel with Gaussian ridges as a height field, and captures of it.

Every length, width and height is known: a ridge of height h and sigma s has its inflections 2 s
apart and h (1 - exp(-1/2)) below its top.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.capture import Capture

#: Length over which a ridge fades out at either end, multiples of sigma.
_TAPER_SIGMAS = 2.5

#: Distance over which the cloth's edge comes down to the table, metres.
_EDGE_M = 0.003


@dataclass(frozen=True)
class Ridge:
    """Straight Gaussian ridge that fades out at its ends.

    Attributes:
        centre: world x, y of its centre, metres.
        angle: of its line from the world's x axis, radians.
        height: above the surrounding cloth, metres.
        sigma: of the Gaussian across it, metres.
        length: distance of the points at half its height, metres.
    """

    centre: tuple[float, float]
    angle: float
    height: float
    sigma: float
    length: float

    def at(self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the height of the ridge at world points, metres."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        along = (x - self.centre[0]) * c + (y - self.centre[1]) * s
        across = (y - self.centre[1]) * c - (x - self.centre[0]) * s
        fade = _TAPER_SIGMAS * self.sigma
        inside = np.clip((0.5 * self.length + 0.5 * fade - np.abs(along)) / fade, 0.0, 1.0)
        window = inside * inside * inside * (10.0 - 15.0 * inside + 6.0 * inside * inside)
        ridge: NDArray[np.float64] = (
            self.height * window * np.exp(-0.5 * (across / self.sigma) ** 2)
        )
        return ridge


@dataclass(frozen=True)
class Towel:
    """Square towel with ridges on a level table.

    Attributes:
        ridges: the ridges, largest first by convention.
        centre: world x, y, metres.
        side: metres.
        yaw: rotation about world z, radians.
        thickness: of the cloth, metres.
        corner: radius of its corners, metres.
        table_height: world z of the table, metres.
        waviness: amplitude of its wavy outline, metres.
        seed: of the outline.
    """

    ridges: tuple[Ridge, ...]
    centre: tuple[float, float] = (0.0, -1.10)
    side: float = 0.48
    yaw: float = 0.0
    thickness: float = 0.002
    corner: float = 0.015
    table_height: float = 0.70
    waviness: float = 0.002
    seed: int = 0

    def edge_distance(
        self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]
    ) -> NDArray[np.float64]:
        """Return the distance of world points from the outline, metres, positive inside."""
        u, v = self._own(x, y)
        phases = np.random.default_rng(self.seed).uniform(0.0, 2.0 * np.pi, 4)
        wave = np.sin(u * 21.0 + phases[0]) + np.sin(u * 47.0 + phases[1])
        wave = wave + np.sin(v * 25.0 + phases[2]) + np.sin(v * 41.0 + phases[3])
        half = 0.5 * self.side - self.corner
        over_u, over_v = np.abs(u) - half, np.abs(v) - half
        outside = np.hypot(np.maximum(over_u, 0.0), np.maximum(over_v, 0.0))
        distance = outside + np.minimum(np.maximum(over_u, over_v), 0.0) - self.corner
        result: NDArray[np.float64] = -distance + 0.25 * self.waviness * wave
        return result

    def height(
        self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]
    ) -> NDArray[np.float64]:
        """Return the height above the table at world points, metres; 0 outside the towel."""
        step = np.clip(self.edge_distance(x, y) / _EDGE_M, 0.0, 1.0)
        rise = step * step * (3.0 - 2.0 * step)
        bare = np.full(np.shape(x), self.thickness)
        for ridge in self.ridges:
            bare = bare + ridge.at(x, y)
        return rise * bare

    def colours(
        self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]
    ) -> NDArray[np.float64]:
        """Return RGB (..., 3) in 0..255 at world points, under diffuse light from one side."""
        u, v = self._own(x, y)
        cloth = np.empty((*np.shape(x), 3))
        cloth[:] = (62.0, 116.0, 158.0)
        stripe = np.abs(np.abs(v) - 0.40 * self.side) < 0.012
        cloth[stripe] = (226.0, 220.0, 204.0)
        cloth += 7.0 * (np.sin(u * 520.0) * np.sin(v * 520.0))[..., None]
        wood = np.empty_like(cloth)
        wood[:] = (188.0, 170.0, 148.0)
        wood += 5.0 * np.sin(x * 90.0 + 2.0 * np.sin(y * 13.0))[..., None]
        on = self.edge_distance(x, y) > 0.0
        step = 0.0005
        slope_x = (self.height(x + step, y) - self.height(x - step, y)) / (2.0 * step)
        slope_y = (self.height(x, y + step) - self.height(x, y - step)) / (2.0 * step)
        light = np.array([0.45, -0.35, 0.82])
        shade = light[2] - light[0] * slope_x - light[1] * slope_y
        shade /= light[2] * np.sqrt(1.0 + slope_x**2 + slope_y**2)
        shaded = np.where(on[..., None], cloth, wood)
        return np.asarray(shaded * np.clip(0.25 + 0.75 * shade, 0.1, 1.25)[..., None])

    def _own(
        self, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        right, up = np.asarray(x) - self.centre[0], np.asarray(y) - self.centre[1]
        return c * right + s * up, c * up - s * right


def overhead_pose(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return X_WC of a camera that looks down, its image's top away from the robot (-y)."""
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    X_WC[:3, 3] = (x, y, z)
    return X_WC


def sensor_noise(
    depth: NDArray[np.float64], sigma: float, step: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Add the noise of a depth sensor; return depth (h, w), metres.

    Args:
        depth: (h, w) metres, 0 for no reading.
        sigma: standard deviation at 1 m, metres. White noise without a step; otherwise correlated
            over some pixels, as of structured light, and growing with the square of the depth.
        step: quantisation step at 1 m, metres; 0 for none.
        rng: random generator.
    """
    noise = rng.standard_normal(depth.shape)
    if step <= 0.0:
        return np.where(depth > 0.0, depth + sigma * noise, 0.0)
    noise = gaussian_filter(noise, 2.0)
    noise *= sigma / noise.std()
    inverse = 1.0 / np.where(depth > 0.0, depth, 1.0) - noise
    return np.where(depth > 0.0, 1.0 / (np.rint(inverse / step) * step), 0.0)


def capture_of(
    towel: Towel,
    camera: Camera,
    X_WC: NDArray[np.float64],
    *,
    sigma: float = 0.0001,
    step: float = 0.0,
    seed: int = 0,
    name: str = "towel",
) -> Capture:
    """Simulate a capture of the towel, with colour registered to depth.

    Args:
        towel: the towel.
        camera: intrinsics.
        X_WC: (4, 4) pose of the camera; its rays must be steeper than the cloth.
        sigma, step: see `sensor_noise`.
        seed: of the noise.
        name: of the capture.
    """
    ray_x, ray_y = camera.rays()
    rays_W = np.stack([ray_x, ray_y, np.ones_like(ray_x)], axis=-1) @ X_WC[:3, :3].T
    eye = X_WC[:3, 3]
    surface = np.full(ray_x.shape, towel.table_height)
    # Fixed-point iteration; converges quickly for steep rays and gentle slopes.
    for _ in range(15):
        depth = (surface - eye[2]) / rays_W[..., 2]
        x, y = eye[0] + depth * rays_W[..., 0], eye[1] + depth * rays_W[..., 1]
        surface = towel.table_height + towel.height(x, y)
    rng = np.random.default_rng(seed)
    colours = towel.colours(x, y) + 2.0 * rng.standard_normal((*depth.shape, 1))
    colours = cv2.GaussianBlur(colours, (3, 3), 0.6)
    return Capture(
        depth=sensor_noise(depth, sigma, step, rng).astype(np.float32),
        camera=camera,
        colour=np.clip(np.rint(colours), 0, 255).astype(np.uint8),
        colour_registered=True,
        X_WC=X_WC,
        name=name,
    )


def wrinkled_towel(seed: int = 0) -> Towel:
    """Return a towel with one largest and two smaller wrinkles, drawn from the seed."""
    rng = np.random.default_rng(seed)
    turn = float(rng.uniform(-0.06, 0.06))
    centre = (0.0, -1.10)
    largest = Ridge(
        centre=(centre[0] - 0.02 + rng.uniform(-0.01, 0.01), centre[1] + rng.uniform(-0.01, 0.01)),
        angle=float(np.radians(72.0 + rng.uniform(-4.0, 4.0))),
        height=0.021,
        sigma=0.0125,
        length=0.32,
    )
    second = Ridge(
        centre=(centre[0] + 0.13 + rng.uniform(-0.005, 0.005), centre[1] - 0.05),
        angle=float(np.radians(98.0 + rng.uniform(-4.0, 4.0))),
        height=0.017,
        sigma=0.0105,
        length=0.20,
    )
    third = Ridge(
        centre=(centre[0] - 0.155, centre[1] + 0.06 + rng.uniform(-0.01, 0.01)),
        angle=float(np.radians(55.0 + rng.uniform(-4.0, 4.0))),
        height=0.015,
        sigma=0.0095,
        length=0.11,
    )
    return Towel(ridges=(largest, second, third), centre=centre, yaw=turn, seed=seed)
