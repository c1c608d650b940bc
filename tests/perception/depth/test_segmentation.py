"""Segmentation of the garment by depth, by registered and by aligned colour."""

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InsufficientViewError, NoGarmentError
from unwrinkle.perception.depth.color_registration import align_colour
from unwrinkle.perception.depth.segmentation import one_piece, segment
from unwrinkle.perception.sensor import noise_profile

SHAPE = (240, 320)


def _truth() -> np.ndarray:
    image = np.zeros(SHAPE, np.uint8)
    corners = np.array([[70, 60], [240, 45], [255, 150], [160, 130], [150, 205], [80, 190]])
    cv2.fillPoly(image, [corners], 1)
    return image > 0


def _heights(rng: np.random.Generator, thick: float, thin: float) -> np.ndarray:
    """Cloth with a thick half and a thin half, on a noisy table."""
    height = np.where(_truth(), thin, 0.0)
    height[:, :150] = np.where(_truth()[:, :150], thick, 0.0)
    noise = cv2.GaussianBlur(rng.standard_normal(SHAPE), (0, 0), 1.0)
    return np.asarray(height + 0.002 * noise / noise.std())


def _picture(rng: np.random.Generator, mask: np.ndarray) -> np.ndarray:
    picture = np.where(mask[..., None], (60, 90, 150), (200, 195, 180)).astype(float)
    return np.clip(picture + 6.0 * rng.standard_normal(picture.shape), 0, 255).astype(np.uint8)


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sum(a & b) / np.sum(a | b))


def test_depth_alone_finds_thick_cloth() -> None:
    height = _heights(np.random.default_rng(0), 0.012, 0.012)
    found = segment(height, np.ones(SHAPE, bool), noise_profile("xtion"))
    assert found.method == "depth"
    assert found.colour is None
    assert _overlap(found.garment, _truth()) > 0.9


def test_colour_finds_what_is_too_thin_for_depth() -> None:
    rng = np.random.default_rng(0)
    height = _heights(rng, 0.012, 0.001)
    colour = _picture(rng, _truth())
    seen = np.ones(SHAPE, bool)
    alone = segment(height, seen, noise_profile("xtion"))
    both = segment(height, seen, noise_profile("xtion"), colour=colour)
    assert _overlap(alone.garment, _truth()) < 0.7
    assert both.method == "colour"
    assert _overlap(both.garment, _truth()) > 0.97


def test_shifted_and_scaled_colour_is_laid_over_depth() -> None:
    rng = np.random.default_rng(0)
    height = _heights(rng, 0.012, 0.002)
    # From depth pixels to the colour image's, which is larger and sees less.
    depth_to_colour = np.array([[1.9, 0.02, 20.0], [-0.02, 1.9, 14.0]])
    mask = cv2.warpAffine(_truth().astype(np.uint8), depth_to_colour, (640, 512)) > 0
    seen = np.ones(SHAPE, bool)
    found = segment(
        height, seen, noise_profile("xtion"), colour=_picture(rng, mask), registered=False
    )
    assert found.method == "aligned colour"
    assert found.alignment is not None
    corner = np.array([100.0, 100.0, 1.0])
    back = found.alignment @ np.append(depth_to_colour @ corner, 1.0)
    np.testing.assert_allclose(back, corner[:2], atol=4.0)
    assert _overlap(found.garment, _truth()) > 0.88


def test_useless_colour_leaves_it_to_depth() -> None:
    rng = np.random.default_rng(0)
    height = _heights(rng, 0.012, 0.012)
    noise = rng.integers(0, 255, (*SHAPE, 3)).astype(np.uint8)
    found = segment(
        height, np.ones(SHAPE, bool), noise_profile("xtion"), colour=noise, registered=False
    )
    assert _overlap(found.garment, _truth()) > 0.85


def test_alignment_of_unlike_things_is_none() -> None:
    rng = np.random.default_rng(1)
    mask = np.zeros(SHAPE, bool)
    mask[20:40, 20:40] = True
    flat = 0.0001 * rng.standard_normal(SHAPE)
    assert align_colour(mask, flat, np.ones(SHAPE, bool), span=0.004) is None
    assert align_colour(~np.zeros(SHAPE, bool), flat, np.ones(SHAPE, bool), span=0.004) is None


def test_same_seed_same_mask() -> None:
    rng = np.random.default_rng(0)
    height, colour = _heights(rng, 0.012, 0.001), _picture(rng, _truth())
    seen = np.ones(SHAPE, bool)
    first, second = (
        segment(height, seen, noise_profile("xtion"), colour=colour, seed=3).garment
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("seed", range(5))
def test_bare_table_has_no_garment(seed: int) -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((480, 640)), (0, 0), 2.5)
    height = 0.002 * noise / noise.std()
    with pytest.raises(NoGarmentError, match="no garment"):
        segment(height, np.ones((480, 640), bool), noise_profile("xtion"))


def test_all_garment_is_refused() -> None:
    with pytest.raises(InsufficientViewError, match="fills"):
        segment(np.full(SHAPE, 0.02), np.ones(SHAPE, bool), noise_profile("xtion"))


def test_one_piece_keeps_the_largest_and_fills_it() -> None:
    mask = np.zeros((60, 80), bool)
    mask[10:50, 10:50] = True
    mask[25:35, 25:35] = False
    mask[5:9, 70:74] = True
    piece = one_piece(mask)
    assert piece[30, 30]
    assert not piece[:, 60:].any()
    assert piece.sum() == pytest.approx(1600, rel=0.01)
