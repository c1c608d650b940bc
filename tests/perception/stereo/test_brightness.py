"""Brightness of the eyes: gain, offset and gamma compensated, or refused with the figure."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo.brightness import check_exposures, equalized


def _image(seed: int = 0) -> np.ndarray:
    """Return a cloth on a table, with texture."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.standard_normal((300, 400)), (0, 0), 2.0)
    image = 120.0 + 25.0 * texture / texture.std()
    image[80:220, 100:300] *= 0.55
    return np.clip(image, 1, 255).astype(np.uint8)


def _changed(change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return np.clip(np.rint(change(_image().astype(float))), 0, 255).astype(np.uint8)


def _off(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.median(np.abs(first.astype(float) - second.astype(float))))


@pytest.mark.parametrize(
    "change",
    [
        lambda x: 0.9 * x,
        lambda x: 0.7 * x,
        lambda x: 0.5 * x,
        lambda x: 1.3 * x,
        lambda x: x + 25.0,
        lambda x: 0.8 * x + 12.0,
        lambda x: 255.0 * (x / 255.0) ** 0.6,
        lambda x: 255.0 * (x / 255.0) ** 1.6,
    ],
)
def test_a_smooth_change_is_taken_out(
    change: Callable[[np.ndarray], np.ndarray], caplog: pytest.LogCaptureFixture
) -> None:
    right = _changed(change)
    assert _off(equalized(_image(), right, "pair"), _image()) <= 2.0
    assert "times as bright" in caplog.text


def test_equal_eyes_keep_their_bits() -> None:
    left, right = _image(), np.roll(_image(), -12, axis=1)
    assert equalized(left, right, "pair") is right
    slightly = _changed(lambda x: 1.02 * x)
    assert equalized(left, slightly, "pair") is slightly


def test_what_is_outside_the_view_stays_dark() -> None:
    right = _changed(lambda x: 0.7 * x)
    right[:, :50] = 0
    assert (equalized(_image(), right, "pair")[:, :50] == 0).all()


@pytest.mark.parametrize(
    "change",
    [
        lambda x: 0.3 * x,
        lambda x: 4.0 * x,  # clipped
        lambda x: np.where(x > 90.0, 20.0, 100.0),
    ],
)
def test_another_change_is_refused_with_its_figure(
    change: Callable[[np.ndarray], np.ndarray],
) -> None:
    with pytest.raises(InputError, match=r"pair: .*(times|levels).*exposure"):
        equalized(_image(), _changed(change), "pair")


def test_exposures_that_no_feature_survives() -> None:
    check_exposures(_image(), _changed(lambda x: 0.6 * x), "pair")
    with pytest.raises(InputError, match="exposure"):
        check_exposures(_image(), _changed(lambda x: 0.3 * x), "pair")
