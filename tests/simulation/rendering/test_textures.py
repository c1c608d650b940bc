"""Textures: contrast, repeatability, lossless PNG."""

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.rendering.textures import Texture, cloth, uniform, wood

SIZE = (0.12, 0.09)


def _contrast(texture: Texture) -> float:
    """Standard deviation of what is finer than 31 pixels, grey levels."""
    grey = cv2.cvtColor(texture.pixels, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float((grey - cv2.blur(grey, (31, 31))).std())


def test_size_is_metres_over_texel() -> None:
    assert cloth("terry", SIZE).pixels.shape == (300, 400, 3)
    assert cloth("terry", SIZE, texel=0.0006).pixels.shape == (150, 200, 3)
    assert wood(SIZE).pixels.shape == (300, 400, 3)


def test_same_seed_same_texture_and_another_one_another() -> None:
    first = cloth("terry", SIZE, seed=5)
    assert cloth("terry", SIZE, seed=5) is first
    cloth.cache_clear()
    again = cloth("terry", SIZE, seed=5)
    assert again is not first
    np.testing.assert_array_equal(again.pixels, first.pixels)
    other = cloth("terry", SIZE, seed=6)
    assert np.mean(other.pixels != first.pixels) > 0.9


def test_plain_cloth_is_four_times_weaker_than_terry() -> None:
    terry, plain = _contrast(cloth("terry", SIZE)), _contrast(cloth("plain", SIZE))
    assert 25.0 < terry < 42.0  # the lens and the renderer's filter take a third of it
    assert terry / plain == pytest.approx(4.0, rel=0.1)


def test_print_is_coloured_and_terry_is_not() -> None:
    def hues(kind: str) -> float:
        pixels = cloth(kind, (0.3, 0.3)).pixels.astype(float)
        return float((pixels[..., 2] - pixels[..., 0]).std())

    assert hues("print") > hues("terry") + 8.0


def test_wood_runs_along_x() -> None:
    grey = wood((0.3, 0.3)).pixels[..., 0].astype(float)
    fine = grey - cv2.blur(grey, (31, 31))
    along = np.mean(fine[:, 4:] * fine[:, :-4]) / fine.var()
    across = np.mean(fine[4:] * fine[:-4]) / fine.var()
    assert along > across + 0.2


def test_png_holds_the_pixels() -> None:
    texture = cloth("print", SIZE)
    decoded = cv2.imdecode(np.frombuffer(texture.png, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded[..., ::-1], texture.pixels)
    assert texture.png is texture.png


def test_pixels_are_read_only() -> None:
    with pytest.raises(ValueError):
        uniform((1, 2, 3)).pixels[0, 0] = 0


def test_bad_textures_are_refused() -> None:
    with pytest.raises(InputError, match=r"silk.*terry, print, plain"):
        cloth("silk", SIZE)
    with pytest.raises(InputError, match="100 million"):
        cloth("plain", (5.0, 5.0))
    with pytest.raises(InputError, match="wanted uint8"):
        Texture(np.zeros((4, 4), dtype=np.uint8))
