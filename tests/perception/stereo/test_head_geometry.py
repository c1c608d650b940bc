"""Projection into both distorted cameras and triangulation recover a world point at any gaze."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.rectification import rectify

HEAD = nominal_head()


def seen_again(
    pixels: NDArray[np.float64], camera: Camera, R: NDArray[np.float64], rectified: Camera
) -> NDArray[np.float64]:
    """Where pixels (n, 2) of a distorted camera go in a rectified one, through OpenCV."""
    P = np.column_stack([rectified.matrix, np.zeros(3)])
    found = cv2.undistortPoints(
        pixels[:, None], camera.matrix, np.array(camera.distortion), R=R, P=P
    )
    return np.asarray(found)[:, 0]


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-0.35, 0.35),
    y=st.floats(-1.55, -0.85),
    ext=st.floats(-0.5, 0.5),
    seed=st.integers(0, 999),
)
def test_project_rectify_triangulate_under_any_gaze(
    x: float, y: float, ext: float, seed: int
) -> None:
    turned = HEAD.turntable_pose(ext)[:3, :3] @ np.array([-y, x, 0.0])
    target = np.array([turned[0], turned[1], 0.70])
    gaze = HEAD.gaze_at(target, ext)
    X_WL, X_WR = HEAD.poses(gaze)
    points_W = target + np.random.default_rng(seed).uniform(-0.15, 0.15, (20, 3))
    cameras = HEAD.left.camera, HEAD.right.camera
    pixels = [
        camera.project(transformed(inverse(X_WC), points_W))
        for camera, X_WC in zip(cameras, (X_WL, X_WR), strict=True)
    ]
    rectification = rectify(*cameras, HEAD.relative(gaze))
    left = seen_again(pixels[0], cameras[0], rectification.R_CL, rectification.camera)
    right = seen_again(pixels[1], cameras[1], rectification.R_CR, rectification.right_camera)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-3)
    z = rectification.depth(left[:, 0] - right[:, 0])
    camera = rectification.camera
    p_CQ = np.column_stack(
        [
            (left[:, 0] - camera.cx) / camera.fx * z,
            (left[:, 1] - camera.cy) / camera.fy * z,
            z,
        ]
    )
    np.testing.assert_allclose(transformed(X_WL @ rectification.X_LC, p_CQ), points_W, atol=2e-5)
