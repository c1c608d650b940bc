"""OpenCV's camera model with analytic derivatives, for estimating intrinsics."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.camera import Camera

#: Number of estimated intrinsics: fx, fy, cx, cy, k1, k2.
INTRINSICS = 6


def project_with_derivatives(
    p_C: NDArray[np.float64], numbers: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return pixels (n, 2), derivatives by the point (n, 2, 3) and by the intrinsics (n, 2, 6).

    OpenCV's model: x (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 x y + p2 (r2 + 2 x^2), and so for y.

    Args:
        p_C: (n, 3) points in front of the camera, metres.
        numbers: (n, 9) `constants` of each point's camera.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = numbers.T
    inverse_z = 1.0 / p_C[:, 2]
    x, y = p_C[:, 0] * inverse_z, p_C[:, 1] * inverse_z
    r2 = x * x + y * y
    gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))  # of gain, per x and y
    u = x * gain + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * gain + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    mixed = x * y * slope + 2.0 * (p1 * x + p2 * y)
    u_x = gain + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    v_y = gain + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    by_ray = np.stack([np.stack([fx * u_x, fx * mixed]), np.stack([fy * mixed, fy * v_y])])
    by_ray = np.moveaxis(by_ray, 2, 0)
    by_point = np.empty((len(x), 2, 3))
    by_point[:, :, :2] = by_ray * inverse_z[:, None, None]
    by_point[:, :, 2] = -(by_point[:, :, 0] * x[:, None] + by_point[:, :, 1] * y[:, None])
    nought, one = np.zeros_like(x), np.ones_like(x)
    by_camera = np.stack(
        [
            np.stack([u, nought, one, nought, fx * x * r2, fx * x * r2 * r2], axis=1),
            np.stack([nought, v, nought, one, fy * y * r2, fy * y * r2 * r2], axis=1),
        ],
        axis=1,
    )
    return np.column_stack([fx * u + cx, fy * v + cy]), by_point, by_camera


def constants(camera: Camera) -> NDArray[np.float64]:
    """Return fx, fy, cx, cy, k1, k2, p1, p2, k3, (9,)."""
    numbers = np.zeros(9)
    numbers[:4] = camera.fx, camera.fy, camera.cx, camera.cy
    numbers[4 : 4 + len(camera.distortion)] = camera.distortion
    return numbers


def with_step(camera: Camera, step: NDArray[np.float64]) -> Camera:
    """Return the camera with a step (6,) added to its estimated intrinsics.

    Raises:
        InputError: the result is not a plausible camera.
    """
    numbers = constants(camera)
    numbers[:INTRINSICS] += step
    fx, fy, cx, cy = (float(number) for number in numbers[:4])
    return dataclasses.replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, distortion=numbers[4:].tolist())


def crosses(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix [p]x of each row, (n, 3, 3): [p]x q is the cross product of p and q."""
    result = np.zeros((len(p), 3, 3))
    result[:, 0, 1], result[:, 0, 2], result[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    result[:, 1, 0], result[:, 2, 0], result[:, 2, 1] = p[:, 2], -p[:, 1], p[:, 0]
    return result
