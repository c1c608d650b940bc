"""The camera model with derivatives against OpenCV's and against finite differences."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from unwrinkle.perception.calibration.projection import (
    INTRINSICS,
    constants,
    crosses,
    project_with_derivatives,
    with_step,
)
from unwrinkle.perception.camera import Camera

seeds = st.integers(0, 10_000)


def _case(seed: int) -> tuple[Camera, NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    distortion = (rng.uniform(-1.0, 1.0, 5) * [0.2, 0.3, 0.01, 0.01, 0.1]).tolist()
    camera = Camera("c", 1000, 800, 900.0, 950.0, 480.0, 420.0, distortion)
    z = rng.uniform(0.5, 3.0, 20)
    return camera, np.column_stack([rng.uniform(-0.5, 0.5, (20, 2)) * z[:, None], z])


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_projection_is_opencvs(seed: int) -> None:
    camera, points = _case(seed)
    found, _, _ = project_with_derivatives(points, np.tile(constants(camera), (20, 1)))
    wanted, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    np.testing.assert_allclose(found, np.reshape(wanted, (-1, 2)), atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_derivatives_are_those_of_small_steps(seed: int) -> None:
    camera, points = _case(seed)

    def seen(camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return project_with_derivatives(points, np.tile(constants(camera), (20, 1)))[0]

    _, by_point, by_camera = project_with_derivatives(points, np.tile(constants(camera), (20, 1)))
    step = 1e-6
    for k in range(3):
        change = seen(camera, points + step * np.eye(3)[k]) - seen(
            camera, points - step * np.eye(3)[k]
        )
        np.testing.assert_allclose(by_point[:, :, k], change / (2.0 * step), rtol=1e-5, atol=1e-3)
    for k in range(INTRINSICS):
        steps = step * np.eye(INTRINSICS)[k]
        change = seen(with_step(camera, steps), points) - seen(with_step(camera, -steps), points)
        np.testing.assert_allclose(by_camera[:, :, k], change / (2.0 * step), rtol=1e-5, atol=1e-3)


@given(seed=seeds)
def test_crosses_multiply(seed: int) -> None:
    p, q = np.random.default_rng(seed).normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", crosses(p), q), np.cross(p, q), atol=1e-12)
