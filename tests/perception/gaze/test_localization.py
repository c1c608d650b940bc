"""Sub-pixel localization on images with a known mapping."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.perception.features import mapped, template, view
from unwrinkle.perception.gaze.localization import NotSeen, Sighting, correspond, locate

MIDDLE = (299.0, 204.0)


def cloth(strength: float = 30.0, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    image = np.full((408, 616), 120.0)
    for sigma in (1.2, 3.0, 8.0):
        noise = cv2.GaussianBlur(rng.standard_normal(image.shape), (0, 0), sigma)
        image += strength / 1.7 * noise / noise.std()
    return np.clip(image, 20.0, 235.0)


def photo(image: NDArray[np.float64], seed: int, gain: float = 1.0) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).standard_normal(image.shape)
    noisy = gain * image + np.sqrt(0.35 * image + 1.44) * noise
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


H = np.array([[0.95, -0.17, 40.0], [0.18, 1.04, -60.0], [6e-5, -8e-5, 1.0]])


@pytest.mark.parametrize(("strength", "tolerance"), [(30.0, 0.06), (7.5, 0.3)])
def test_the_place_is_known_to_hundredths_of_a_pixel(strength: float, tolerance: float) -> None:
    image = cloth(strength)
    turned = cv2.warpPerspective(image, H, (616, 408), flags=cv2.INTER_CUBIC, borderValue=120.0)
    thing = template(view(photo(image, 1)), box=(150, 100, 450, 300), point=MIDDLE)
    seen = locate(thing, view(photo(turned, 2, gain=0.93)))
    assert isinstance(seen, Sighting)
    assert seen.sharp
    assert np.linalg.norm(seen.pixel - mapped(H, np.array(MIDDLE))) < tolerance


def test_a_wrinkle_moves_its_own_points_only() -> None:
    image = cloth()
    u, v = np.meshgrid(np.arange(616.0), np.arange(408.0))
    # Pixel (u, v) shows what was 6 pixels to the right where the ridge is.
    shift = 6.0 * np.exp(-0.5 * ((u - 299.0) / 30.0) ** 2)
    bent = cv2.remap(image, (u + shift).astype(np.float32), v.astype(np.float32), cv2.INTER_CUBIC)
    first, second = view(photo(image, 1)), view(photo(bent, 2))
    for place, expected in ((305.0, 299.0), (150.0, 150.0)):
        seen = correspond(first, np.array([place, 204.0]), second)
        assert isinstance(seen, Sighting)
        assert seen.sharp
        np.testing.assert_allclose(seen.pixel, [expected, 204.0], atol=0.4)


@pytest.mark.parametrize("seed", range(4))
def test_a_steep_slope_shifts_no_place(seed: int) -> None:
    # A shift alone was off by a pixel here: within its window the cloth is stretched by a quarter.
    image = cloth(seed=seed)
    u, v = np.meshgrid(np.arange(616.0), np.arange(408.0))
    shift = 10.0 * np.exp(-0.5 * ((u - 299.0) / 24.0) ** 2)
    bent = cv2.remap(image, (u + shift).astype(np.float32), v.astype(np.float32), cv2.INTER_CUBIC)
    first, second = view(photo(image, 1)), view(photo(bent, 2))
    for column in (275, 323):
        seen = correspond(first, np.array([column + shift[0, column], 204.0]), second)
        assert isinstance(seen, Sighting)
        assert seen.sharp
        np.testing.assert_allclose(seen.pixel, [column, 204.0], atol=0.45)


def test_a_target_partly_outside_has_a_place_there_but_no_sharp_one() -> None:
    image = cloth()
    away = np.array([[1.0, 0.0, 330.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    moved = cv2.warpPerspective(image, away, (616, 408), borderValue=120.0)
    thing = template(view(photo(image, 1)), box=(100, 50, 500, 350))
    seen = locate(thing, view(photo(moved, 2)))
    assert isinstance(seen, Sighting)
    assert not seen.sharp
    np.testing.assert_allclose(seen.pixel, [630.0, 200.0], atol=2.0)
    nowhere = correspond(view(photo(moved, 2)), seen.pixel, view(photo(image, 1)))
    assert isinstance(nowhere, NotSeen)
    assert "outside the other eye's image" in nowhere.reason


def test_a_place_that_changed_is_not_sharp() -> None:
    image = cloth()
    changed = image.copy()
    changed[140:268, 235:363] = cloth(seed=5)[140:268, 235:363]
    thing = template(view(photo(image, 1)), box=(100, 50, 500, 350), point=MIDDLE)
    seen = locate(thing, view(photo(changed, 2)))
    assert isinstance(seen, Sighting)
    assert not seen.sharp
    np.testing.assert_allclose(seen.pixel, MIDDLE, atol=0.5)


@pytest.mark.parametrize("grey", [0.0, 255.0])
def test_a_place_without_texture_is_not_sharp(grey: float) -> None:
    image = photo(cloth(), 1)
    blank = image.copy()
    blank[104:304, 199:399] = int(grey)
    thing = template(view(image), box=(50, 30, 550, 380), point=MIDDLE)
    for first, second in ((thing, blank), (template(view(blank), point=MIDDLE), blank)):
        seen = locate(first, view(second))
        assert isinstance(seen, Sighting)
        assert not seen.sharp


def test_something_else_is_not_seen() -> None:
    thing = template(view(photo(cloth(), 1)), "towel", box=(150, 100, 450, 300))
    other = view(photo(cloth(seed=9), 2))
    seen = locate(thing, other)
    assert isinstance(seen, NotSeen)
    assert seen.reason.startswith("towel: too few of its")
    assert isinstance(correspond(view(photo(cloth(), 1)), np.array(MIDDLE), other), NotSeen)
