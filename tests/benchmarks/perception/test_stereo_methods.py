"""The matchers that ours is compared with do match."""

import cv2
import numpy as np
import pytest

from benchmarks.perception.stereo.methods import METHODS


@pytest.mark.parametrize("name", list(METHODS))
@pytest.mark.parametrize("shape", [(420, 640), (421, 641)])
def test_each_method_finds_a_slope(name: str, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, shape).astype(np.float32), (0, 0), 1.5)
    texture = cv2.normalize(texture, None, 20, 235, cv2.NORM_MINMAX)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    # u_left - u_right = -5.4 + 0.02 u_left: the left image is the right one, stretched.
    truth = -5.4 + 0.02 * x
    left = cv2.remap(texture, x - truth, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    images = [np.clip(np.rint(image), 1, 255).astype(np.uint8) for image in (left, texture)]
    result = METHODS[name](*images, -16, 31)
    part = (slice(40, -40), slice(60, -60))
    assert result.disparity.shape == result.valid.shape == shape
    assert result.valid[part].mean() > 0.95
    error = (result.disparity - truth)[part][result.valid[part]]
    assert np.median(np.abs(error)) < 0.3  # SGBM leans towards whole pixels
    assert abs(np.median(error)) < 0.12
