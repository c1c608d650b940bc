"""Matching of pairs with known disparity, and of pairs without any."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo.matching import Disparity, ImageNoise, match

Field = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
NOISE = ImageNoise(0.0, 3.0)
LEAST = (408, 616)  # matched at full size at once
LARGE = (1088, 1408)  # three scales above the finest


@cache
def pair(
    shape: tuple[int, int], field: Field, *, seed: int = 0, contrast: float = 30.0
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float64]]:
    """Return left and right image of a random texture, and the left image's disparity."""
    rng = np.random.default_rng(seed)
    h, w = shape
    texture = sum(gaussian_filter(rng.standard_normal(shape), s) * s for s in (0.9, 2.0, 6.0))
    coefficients = spline_filter(texture * (contrast / texture.std()), order=3)
    y, x = np.mgrid[:h, :w].astype(float)
    # What the right camera sees at x is at x + d in the left image.
    there = x + field(x, y)
    for _ in range(30):
        there = x + field(there, y)
    views = (coefficients_at(coefficients, y, x), coefficients_at(coefficients, y, there))
    left, right = (
        np.clip(np.rint(128.0 + v + rng.normal(0.0, NOISE.read, shape)), 1, 255).astype(np.uint8)
        for v in views
    )
    for image in (left, right):
        image.flags.writeable = False  # shared by the tests
    return left, right, field(x, y)


def coefficients_at(
    coefficients: NDArray[np.float64], y: NDArray[np.float64], x: NDArray[np.float64]
) -> NDArray[np.float64]:
    seen = map_coordinates(coefficients, [y, x], order=3, prefilter=False, mode="mirror")
    return np.asarray(seen)


def waves(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """A slope from negative to positive with wrinkles on it."""
    slope = -9.3 + 0.02 * x + 0.01 * y
    return slope + 2.2 * np.exp(-0.5 * ((x - 0.4 * y - 250.0) / 17.0) ** 2) + np.sin(y / 60.0)


def inner(shape: tuple[int, int], margin: int = 40) -> tuple[slice, slice]:
    return slice(margin, shape[0] - margin), slice(margin, shape[1] - margin)


@pytest.mark.parametrize("shape", [LEAST, LARGE])
def test_disparity_of_a_wrinkled_slope(shape: tuple[int, int]) -> None:
    left, right, truth = pair(shape, waves)
    result = match(left, right, -16, 32, noise=NOISE)
    part = inner(shape)
    assert result.valid[part].mean() > 0.99
    error = (result.disparity - truth)[part][result.valid[part]]
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert abs(error.mean()) < 0.006


@settings(max_examples=8, deadline=None)
@given(
    offset=st.floats(-12.0, 12.0),
    slope=st.floats(-0.04, 0.04),
    tilt=st.floats(-0.04, 0.04),
    seed=st.integers(0, 99),
)
def test_no_bias_at_any_share_of_a_pixel(
    offset: float, slope: float, tilt: float, seed: int
) -> None:
    # A mistake of half a pixel, in columns or rows, moves the mean by 0.02 at least or far more.
    def field(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return offset + slope * (x - 308.0) + tilt * (y - 204.0)

    left, right, truth = pair(LEAST, field, seed=seed)
    result = match(left, right, -40, 40, noise=NOISE)
    part = inner(LEAST, 60)
    assert result.valid[part].mean() > 0.97
    assert abs((result.disparity - truth)[part][result.valid[part]].mean()) < 0.006


def test_cells_are_centred_on_their_pixels() -> None:
    # Steep slopes tell a shift of the 4 x 4 cells of a large image against its pixels.
    for slope, tilt in ((0.06, 0.0), (0.0, 0.06)):

        def field(
            x: NDArray[np.float64],
            y: NDArray[np.float64],
            slope: float = slope,
            tilt: float = tilt,
        ) -> NDArray[np.float64]:
            return slope * (x - 704.0) + tilt * (y - 544.0)

        left, right, truth = pair(LARGE, field)
        result = match(left, right, -45, 45, noise=NOISE)
        part = inner(LARGE, 100)
        assert abs(np.median((result.disparity - truth)[part])) < 0.006


def test_weak_texture_among_noise() -> None:
    left, right, truth = pair(LARGE, waves, contrast=6.0)
    result = match(left, right, -16, 32, noise=NOISE)
    part = inner(LARGE)
    assert result.valid[part].mean() > 0.98
    error = (result.disparity - truth)[part][result.valid[part]]
    assert np.sqrt(np.mean(error**2)) < 0.2
    assert abs(error.mean()) < 0.02


def test_sigma_tells_the_error() -> None:
    for contrast in (6.0, 30.0):
        left, right, truth = pair(LARGE, waves, contrast=contrast)
        result = match(left, right, -16, 32, noise=NOISE)
        assert result.sigma is not None and result.sigma.shape == left.shape
        part = inner(LARGE)
        error = np.abs(result.disparity - truth)[part][result.valid[part]]
        spread = 1.4826 * np.median(error / result.sigma[part][result.valid[part]])
        assert 0.4 < spread < 2.5


def test_a_fold_keeps_its_edge() -> None:
    def step(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(y < 544.0 + 0.1 * x, -6.0, 5.0)

    left, right, truth = pair(LARGE, step)
    result = match(left, right, -16, 16, noise=NOISE)
    part = inner(LARGE)
    y, x = np.mgrid[: LARGE[0], : LARGE[1]]
    away = np.abs(y - 544.0 - 0.1 * x)[part]
    valid, error = result.valid[part], np.abs(result.disparity - truth)[part]
    assert valid[away > 20.0].all()
    assert valid[away < 20.0].mean() > 0.3
    assert (error[valid & (away > 8.0)] < 0.3).mean() > 0.999
    # The edge itself, within the cells that it cuts, is not valid rather than wrong.
    assert not (error[valid] > 1.0).any()


def test_brightness_and_contrast_of_the_eyes_may_differ() -> None:
    left, right, truth = pair(LARGE, waves)
    dimmer = np.rint(0.9 * right + 6.0).astype(np.uint8)
    result = match(left, dimmer, -16, 32, noise=NOISE)
    part = inner(LARGE)
    assert result.valid[part].mean() > 0.98
    error = (result.disparity - truth)[part][result.valid[part]]
    assert np.sqrt(np.mean(error**2)) < 0.07 and abs(error.mean()) < 0.01


def grey(level: float, deviation: float, seed: int, shape: tuple[int, int]) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).normal(level, deviation, shape)
    return np.clip(np.rint(noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda left, right: (left, np.zeros_like(right)),
        lambda left, right: (np.zeros_like(left), np.zeros_like(right)),
        lambda left, right: (left, np.full_like(right, 255)),
        lambda left, right: (left, grey(128, 30, 5, right.shape)),
        lambda left, right: (grey(128, 3, 6, left.shape), grey(128, 3, 7, left.shape)),
        lambda left, right: (left, np.roll(right, 6, axis=0)),
        lambda left, right: (left, right[:, ::-1]),
    ],
    ids=["black", "both black", "white", "another", "bare noise", "rows off", "mirrored"],
)
def test_pairs_that_do_not_match_are_not_valid(
    spoil: Callable[..., tuple[NDArray[np.uint8], NDArray[np.uint8]]],
) -> None:
    left, right, _ = pair(LEAST, waves)
    result = match(*spoil(left, right), -16, 32, noise=NOISE)
    assert result.valid_fraction < 0.01
    assert not result.disparity[~result.valid].any()


def test_what_is_bare_unseen_or_out_of_range_is_not_valid() -> None:
    def field(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(y > 800.0, 60.0, 0.01 * x)

    left, right, truth = pair(LARGE, field)
    left, right = left.copy(), right.copy()
    for seed, image in ((1, left), (2, right)):
        image[300:560, 300:700] = grey(150, 3, seed, (260, 400))
        image[:, :96] = 0
    result = match(left, right, -8, 24, noise=NOISE)
    assert result.valid[340:520, 340:660].mean() < 0.01
    assert result.valid[850:].mean() < 0.01
    assert not result.valid[:, :90].any()
    good = np.zeros(LARGE, bool)
    good[100:260, 200:1300] = good[600:760, 200:1300] = True
    assert result.valid[good].mean() > 0.99
    assert np.abs(result.disparity - truth)[good & result.valid].max() < 1.0


def test_same_images_give_the_same_disparity() -> None:
    left, right, _ = pair(LARGE, waves)
    first, second = (match(left, right, -16, 32) for _ in range(2))
    np.testing.assert_array_equal(first.disparity, second.disparity)
    np.testing.assert_array_equal(first.valid, second.valid)


@pytest.mark.parametrize("shape", [(409, 617), (1091, 1409)])
def test_any_size_will_do(shape: tuple[int, int]) -> None:
    left, right, truth = pair(shape, waves)
    result = match(left, right, -16, 32, noise=NOISE)
    assert result.disparity.shape == result.valid.shape == shape
    assert result.sigma is not None and result.sigma.shape == shape
    assert np.median(np.abs(result.disparity - truth)[inner(shape)]) < 0.05


@pytest.mark.parametrize(
    ("left", "right", "lowest", "highest", "words"),
    [
        (np.zeros((99, 99), np.uint8), np.zeros((99, 98), np.uint8), 0, 9, "shapes"),
        (np.zeros((99, 99, 3), np.uint8), np.zeros((99, 99, 3), np.uint8), 0, 9, "shapes"),
        (np.zeros((99, 99)), np.zeros((99, 99)), 0, 9, "uint8"),
        (np.zeros((30, 99), np.uint8), np.zeros((30, 99), np.uint8), 0, 9, "at least"),
        (np.zeros((99, 99), np.uint8), np.zeros((99, 99), np.uint8), 9, 9, "search"),
        (np.zeros((99, 99), np.uint8), np.zeros((99, 99), np.uint8), -5, 900, "search"),
    ],
)
def test_bad_input_is_refused(
    left: NDArray[np.uint8], right: NDArray[np.uint8], lowest: int, highest: int, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        match(left, right, lowest, highest)


@pytest.mark.parametrize("gain, read", [(-0.1, 1.0), (0.0, 0.0), (np.nan, 1.0)])
def test_impossible_noise_is_refused(gain: float, read: float) -> None:
    with pytest.raises(InputError, match="noise"):
        ImageNoise(gain, read)


def test_valid_fraction_and_frozen_arrays() -> None:
    left, right, _ = pair(LEAST, waves)
    result = match(left, right, -16, 32, noise=NOISE)
    assert result.valid_fraction == result.valid.mean()
    with pytest.raises(ValueError, match="read-only"):
        result.disparity[0, 0] = 1.0
    assert Disparity(result.disparity, result.valid).sigma is None


def test_real_pair_full_of_edges_is_no_worse_than_sgbm(shared_data: Path) -> None:
    folder = shared_data / "stereo_motorcycle"
    left, right = (
        cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    mode = cv2.STEREO_SGBM_MODE_HH4
    sgbm = cv2.StereoSGBM_create(0, 80, 5, 200, 800, 1, 31, 5, 100, 2, mode)
    theirs = sgbm.compute(left, right).astype(np.float32) / 16.0
    ours = match(left, right, 0, 79)
    both = np.isfinite(truth) & (truth > 0) & (theirs > 0) & ours.valid
    assert both.mean() > 0.6
    errors = [np.abs(d - truth)[both] for d in (ours.disparity, theirs)]
    assert np.median(errors[0]) < 0.8 * np.median(errors[1])
    assert (errors[0] > 1.0).mean() <= (errors[1] > 1.0).mean()
    alone = np.abs(ours.disparity - truth)[np.isfinite(truth) & (truth > 0) & ours.valid]
    assert np.median(alone) < 0.17 and (alone > 1.0).mean() < 0.079
