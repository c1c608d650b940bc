"""Simulated photographs: exact distortion, noise level, vignetting."""

import dataclasses as dc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.rendering.image_noise import (
    IDEAL,
    SensorModel,
    oversized,
    photograph,
    photograph_pair,
    scaled_camera,
)
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import overhead_pose
from unwrinkle.testing.table import TABLE

PLAIN = Camera("p", 320, 240, 500.0, 490.0, 155.3, 124.6)
BENT = dc.replace(PLAIN, distortion=[-0.21, 0.15, 0.002, -0.001, 0.02])
NOISELESS = SensorModel(vignetting=0.0, shot_gain=0.0, read_noise=0.0)


def _waves(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """A smooth scene by the ray's x and y."""
    return 128.0 + 50.0 * np.sin(x * 40.0 + 0.3) + 40.0 * np.cos(y * 33.0 - 15.0 * x)


def _flat(camera: Camera, level: int, channels: int = 3) -> NDArray[np.uint8]:
    return np.full((camera.height, camera.width, channels), level, dtype=np.uint8)


@settings(deadline=None)
@given(
    k1=st.floats(-0.25, 0.25),
    k2=st.floats(-0.3, 0.8),
    p1=st.floats(-0.003, 0.003),
    p2=st.floats(-0.003, 0.003),
    u=st.floats(0.0, 319.0),
    v=st.floats(0.0, 239.0),
)
def test_oversized_camera_sees_every_ray_of_the_distorted_one(
    k1: float, k2: float, p1: float, p2: float, u: float, v: float
) -> None:
    camera = dc.replace(PLAIN, distortion=[k1, k2, p1, p2])
    wide = oversized(camera)
    assert wide.fx == camera.fx and wide.distortion == []
    undistorted = cv2.undistortPointsIter(
        np.array([[[u, v]]]),
        camera.matrix,
        np.array(camera.distortion),
        None,
        None,
        (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    )
    ray = np.append(undistorted.ravel(), 1.0)
    place = wide.project(ray)
    assert 2.0 <= place[0] <= wide.width - 3.0 and 2.0 <= place[1] <= wide.height - 3.0


def test_distortion_folding_the_image_is_refused() -> None:
    with pytest.raises(InputError, match="folds the image"):
        oversized(dc.replace(PLAIN, distortion=[-4.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize("channels", [1, 3])
def test_places_are_those_of_opencvs_distortion(channels: int) -> None:
    """Compared with the scene itself at the undistorted rays; 0.01 pixels would be 0.05 levels."""
    wide = oversized(BENT)
    ideal = np.rint(_waves(*wide.rays())).astype(np.uint8)
    taken = photograph(
        ideal if channels == 1 else np.repeat(ideal[..., None], 3, axis=2),
        wide,
        BENT,
        NOISELESS,
        seed=0,
    )
    assert taken.shape == ((240, 320) if channels == 1 else (240, 320, 3))
    grid = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), axis=-1).reshape(-1, 1, 2)
    rays = cv2.undistortPointsIter(
        grid,
        BENT.matrix,
        np.array(BENT.distortion),
        None,
        None,
        (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    ).reshape(240, 320, 2)
    scene = _waves(rays[..., 0], rays[..., 1])
    error = taken.reshape(240, 320, -1)[..., 0] - scene
    assert np.sqrt(np.mean(error**2)) < 0.5  # rounding to whole levels, twice, and the blur
    slope = np.gradient(scene, axis=1)
    assert abs(np.sum(slope * error) / np.sum(slope**2)) < 0.003  # pixels along x
    slope = np.gradient(scene, axis=0)
    assert abs(np.sum(slope * error) / np.sum(slope**2)) < 0.003


def test_without_distortion_blur_and_noise_the_picture_stays() -> None:
    wide = oversized(PLAIN, IDEAL)
    ideal = np.random.default_rng(0).integers(0, 256, (wide.height, wide.width, 3), dtype=np.uint8)
    left, top = round(wide.cx - PLAIN.cx), round(wide.cy - PLAIN.cy)
    taken = photograph(ideal, wide, PLAIN, IDEAL, seed=0)
    np.testing.assert_array_equal(taken, ideal[top : top + 240, left : left + 320])


def test_blur_spreads_a_dot_by_its_sigma() -> None:
    model = dc.replace(NOISELESS, blur=1.2)
    wide = oversized(PLAIN, model)
    ideal = _flat(wide, 0, 1)[..., 0]
    left, top = round(wide.cx - PLAIN.cx), round(wide.cy - PLAIN.cy)
    ideal[top + 100 : top + 103, left + 150 : left + 153] = 255
    spot = photograph(ideal, wide, PLAIN, model, seed=0).astype(float)
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    weight = spot / spot.sum()
    middle = np.sum(weight * x), np.sum(weight * y)
    assert middle == pytest.approx((151.0, 101.0), abs=0.01)
    # The dot is 3 pixels wide: variance 2/3. The blur's faint tails are rounded to black.
    assert np.sum(weight * (x - middle[0]) ** 2) == pytest.approx(1.44 + 2.0 / 3.0, rel=0.05)


@pytest.mark.parametrize("level", [4, 60, 190])
def test_noise_is_shot_and_read_noise_of_the_grey_value(level: int) -> None:
    model = SensorModel(vignetting=0.0)
    wide = oversized(PLAIN, model)
    taken = photograph(_flat(wide, level), wide, PLAIN, model, seed=3).astype(float)
    expected = np.sqrt(0.35 * level + 1.2**2 + 1.0 / 12.0)
    assert taken.std() == pytest.approx(expected, rel=0.02)
    assert taken.mean() == pytest.approx(level, abs=0.05)
    grey = cv2.cvtColor(taken.astype(np.uint8), cv2.COLOR_RGB2GRAY)
    assert grey.std() == pytest.approx(expected, rel=0.02)  # not averaged down by the channels


def test_noise_comes_from_the_seed() -> None:
    wide = oversized(PLAIN)
    first, again, other = (
        photograph(_flat(wide, 90), wide, PLAIN, seed=seed) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.mean(first != other) > 0.8


def test_light_falls_off_towards_the_corners() -> None:
    model = dc.replace(NOISELESS, vignetting=0.2)
    wide = oversized(PLAIN, model)
    taken = photograph(_flat(wide, 200), wide, PLAIN, model, seed=0)[..., 0]
    assert taken[120, 160] == 200
    assert all(taken[i, j] == 160 for i in (0, -1) for j in (0, -1))
    assert taken[120, 0] == pytest.approx(200 * (1 - 0.2 * 160**2 / (160**2 + 120**2)), abs=1)


def test_nothing_goes_beyond_white() -> None:
    wide = oversized(PLAIN)
    taken = photograph(_flat(wide, 255), wide, PLAIN, seed=0, gain=1.5)
    assert taken.min() == 255


def test_pair_differs_in_noise_and_gain_and_halves_are_averages() -> None:
    renderer = Renderer(TABLE)
    X_WC = overhead_pose(0.0, -1.2, 1.5)
    eyes = (BENT, X_WC, BENT, X_WC)
    model = SensorModel(mismatch=0.1)
    left, right = photograph_pair(renderer, eyes, 5, model=model, quality=1)
    inner = (slice(60, 180), slice(80, 240))
    ratio = left[inner].mean() / right[inner].mean()
    assert ratio == pytest.approx(1.05 / 0.95, rel=0.01)
    rest = left[inner].astype(float) * 0.95 / 1.05 - right[inner]
    assert rest.std() > 6.0
    small, _ = photograph_pair(renderer, eyes, 5, model=model, scale=0.5, quality=1)
    blocks = left.reshape(120, 2, 160, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small, blocks, atol=0.51)
    grey, _ = photograph_pair(renderer, eyes, 5, model=model, colour=False, quality=1)
    assert grey.shape == (240, 320)
    assert grey.mean() == pytest.approx(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY).mean(), abs=0.5)


@pytest.mark.parametrize(
    "settings", [{"blur": 0.2}, {"blur": -1.0}, {"vignetting": 1.0}, {"read_noise": np.nan}]
)
def test_bad_sensor_models_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match="sensor model"):
        SensorModel(**settings)


def test_picture_of_another_size_is_refused() -> None:
    wide = oversized(PLAIN)
    with pytest.raises(InputError, match="320 x 240"):
        photograph(_flat(PLAIN, 9), wide, PLAIN, seed=0)


def test_scaled_camera_averages_whole_blocks() -> None:
    """The image's outer corner, half a pixel beyond the first centre, stays what it is."""
    half = scaled_camera(PLAIN, 0.5)
    assert (half.width, half.height) == (160, 120)
    assert (-0.5 - half.cx) / half.fx == pytest.approx((-0.5 - PLAIN.cx) / PLAIN.fx, rel=1e-12)
    assert scaled_camera(PLAIN, 1.0) == PLAIN


@pytest.mark.parametrize("scale", [0.0, -1.0, 0.3, 1.5, 2.0, np.nan, 1.0 / 7.0])
def test_scales_that_leave_broken_blocks_are_refused(scale: float) -> None:
    with pytest.raises(InputError, match="scale"):
        scaled_camera(PLAIN, scale)
