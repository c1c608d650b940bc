"""Features, matches and the mapping they agree on, on images whose mapping is known."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.features import (
    find,
    local_linear,
    mapped,
    mapping,
    matches,
    template,
    view,
)


def texture(seed: int, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Blotches of several widths."""
    rng = np.random.default_rng(seed)
    image = np.zeros(shape)
    for sigma in (2.0, 4.0, 8.0):
        noise = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), sigma)
        image += noise / noise.std()
    return np.clip(128 + 30 * image, 0, 255).astype(np.uint8)


def test_a_feature_is_where_it_is_drawn_at_any_factor() -> None:
    places = ((150.3, 120.8), (411.5, 250.2))
    for factor in (1, 2, 4):
        image = np.full((400, 600), 90.0)
        v, u = np.indices(image.shape)
        for place in places:
            squares = (u - place[0]) ** 2 + (v - place[1]) ** 2
            image += 120.0 * np.exp(-0.5 * squares / (4.0 * factor) ** 2)
        points = view(np.rint(image).astype(np.uint8), factor=factor).features.points
        for place in places:
            assert np.linalg.norm(points - place, axis=1).min() < 0.15 * factor


def test_colour_and_grey_images_give_the_same() -> None:
    grey = texture(0, (200, 300))
    a, b = view(grey).features, view(np.dstack([grey] * 3)).features
    np.testing.assert_array_equal(a.points, b.points)
    assert len(a) > 50
    np.testing.assert_allclose(np.linalg.norm(a.descriptors, axis=1), 1.0, atol=1e-5)


def test_large_images_are_reduced() -> None:
    assert view(texture(0, (816, 1232))).factor == 3
    assert view(texture(0, (300, 400))).factor == 1


@pytest.mark.parametrize(
    ("angle", "scale", "tilt"), [(0.0, 1.0, 0.0), (0.6, 0.8, 3e-4), (-2.5, 1.2, -2e-4)]
)
def test_a_known_homography_is_found(angle: float, scale: float, tilt: float) -> None:
    source = texture(1, (400, 600))
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    middle = np.array([[1.0, 0.0, -299.5], [0.0, 1.0, -199.5], [0.0, 0.0, 1.0]])
    H = np.linalg.inv(middle) @ [[c, -s, 10.0], [s, c, -6.0], [tilt, 0.5 * tilt, 1.0]] @ middle
    image = cv2.warpPerspective(source, H, (600, 400), flags=cv2.INTER_CUBIC)
    rng = np.random.default_rng(0)
    noisy = np.clip(0.9 * image + 4 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
    found = find(view(source).features, view(noisy).features, 1)
    assert found is not None
    assert found[1] > 50
    probes = np.array([[299.5, 199.5], [350.0, 240.0], [250.0, 160.0]])
    off = mapped(found[0], probes) - mapped(H, probes)
    assert np.abs(off).max() < 0.5


def test_matches_are_mutual_and_distinct() -> None:
    features = view(texture(2, (200, 300))).features
    pairs = matches(features, features)
    assert len(pairs) > 0.8 * len(features)
    np.testing.assert_array_equal(pairs[:, 0], pairs[:, 1])
    both = np.concatenate([np.arange(len(features))] * 2)
    doubled = features.where(both)
    assert len(matches(features, doubled)) == 0  # each has two partners that are alike
    assert len(matches(doubled, features, mutual=False)) == 2 * len(pairs)


def test_other_textures_and_mirrored_ones_are_not_found() -> None:
    source = view(texture(3, (400, 600))).features
    assert find(source, view(texture(4, (400, 600))).features, 1) is None
    mirrored = np.ascontiguousarray(texture(3, (400, 600))[:, ::-1])
    assert find(source, view(mirrored).features, 1) is None
    blank = view(np.full((400, 600), 128, dtype=np.uint8)).features
    assert len(blank) == 0
    assert find(source, blank, 1) is None


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_outliers_do_not_move_the_mapping(seed: int) -> None:
    rng = np.random.default_rng(seed)
    H = np.array([[0.9, -0.2, 30.0], [0.25, 1.1, -20.0], [1e-4, -5e-5, 1.0]])
    p = rng.uniform(0, 600, (80, 2))
    q = mapped(H, p) + 0.2 * rng.standard_normal(p.shape)
    wrong = rng.choice(80, 32, replace=False)
    q[wrong] = rng.uniform(0, 600, (32, 2))
    found = mapping(p, q, tolerance=2.0)
    assert found is not None
    np.testing.assert_allclose(mapped(found[0], p[:5]), mapped(H, p[:5]), atol=1.0)
    assert not found[1][wrong].sum() > 3


def test_too_few_points_and_mirrors_are_no_mapping() -> None:
    rng = np.random.default_rng(0)
    p = rng.uniform(0, 600, (40, 2))
    assert mapping(p[:7], p[:7] + 3.0, tolerance=2.0) is None
    assert mapping(p, p * [-1.0, 1.0], tolerance=2.0) is None
    assert mapping(p, p * [0.01, 0.01], tolerance=0.1) is None
    few = mapping(p[:9], p[:9] * 2.0 + 1.0, tolerance=2.0)
    assert few is not None  # a similarity does
    np.testing.assert_allclose(few[0], [[2, 0, 1], [0, 2, 1], [0, 0, 1]], atol=1e-6)


@given(u=st.floats(-300, 300), v=st.floats(-300, 300))
def test_the_derivative_of_a_homography(u: float, v: float) -> None:
    H = np.array([[0.9, -0.2, 30.0], [0.25, 1.1, -20.0], [1e-4, -5e-5, 1.0]])
    at, step = np.array([u, v]), 1e-3
    slopes = [(mapped(H, at + step * e) - mapped(H, at - step * e)) / (2 * step) for e in np.eye(2)]
    np.testing.assert_allclose(local_linear(H, at), np.column_stack(slopes), atol=1e-6)


def test_beyond_the_horizon_is_nowhere() -> None:
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.01, 0.0, 1.0]])
    assert np.isnan(mapped(H, np.array([[150.0, 0.0], [100.0, 0.0]]))).all()
    np.testing.assert_allclose(mapped(H, np.array([50.0, 10.0])), [100.0, 20.0])


def test_a_template_holds_what_was_cut_out() -> None:
    image = texture(5, (400, 600))
    seen = view(image)
    mask = np.zeros(image.shape, dtype=bool)
    mask[150:250, 300:420] = True
    by_mask = template(seen, mask=mask)
    by_box = template(seen, box=(300, 150, 419, 249), point=(310.0, 160.0))
    for cut in (by_mask, by_box):
        u, v = cut.origin.astype(int)
        h, w = cut.grey.shape
        np.testing.assert_array_equal(cut.grey, image[v : v + h, u : u + w])
        np.testing.assert_allclose(
            cut.corners + cut.origin, [[300, 150], [419, 150], [419, 249], [300, 249]]
        )
        inside = cut.features.points + cut.origin
        assert ((inside >= [300, 150]) & (inside <= [419.5, 249.5])).all()
    np.testing.assert_allclose(by_mask.centre + by_mask.origin, [359.5, 199.5])
    np.testing.assert_allclose(by_box.centre + by_box.origin, [310.0, 160.0])


def test_templates_that_cannot_be_known_again_are_refused() -> None:
    seen = view(texture(6, (200, 300)))
    mask = np.zeros((200, 300), dtype=bool)
    with pytest.raises(InputError, match="empty"):
        template(seen, mask=mask)
    with pytest.raises(InputError, match="not of the image's"):
        template(seen, mask=mask.T)
    with pytest.raises(InputError, match="not both"):
        template(seen, mask=~mask, box=(0, 0, 10, 10))
    with pytest.raises(InputError, match="has nothing of"):
        template(seen, box=(400, 10, 500, 50))
    with pytest.raises(InputError, match="has nothing of"):
        template(seen, box=(10, 10, float("nan"), 50))
    with pytest.raises(InputError, match="features in it"):
        template(seen, box=(10, 10, 12, 12))


def test_what_is_no_image_is_refused() -> None:
    with pytest.raises(InputError, match="wanted uint8"):
        view(np.zeros((100, 100)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="wanted uint8"):
        view(np.zeros((100, 100, 4), dtype=np.uint8))
    with pytest.raises(InputError, match="cannot be reduced by 10"):
        view(np.zeros((100, 100), dtype=np.uint8), factor=10)
