"""Visual search in cluttered images: every instance, its pose, and no false detections."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.features import Template, mapped, template, view
from unwrinkle.perception.gaze.visual_search import Instance, search

SIDE = 160
CORNERS = np.array([[0, 0], [SIDE - 1, 0], [SIDE - 1, SIDE - 1], [0, SIDE - 1]], dtype=float)


def cloth(seed: int, side: int = SIDE) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    image = np.zeros((side, side))
    for sigma in (1.5, 3.0, 6.0):
        noise = cv2.GaussianBlur(rng.standard_normal(image.shape), (0, 0), sigma)
        image += noise / noise.std()
    return np.clip(128 + 28 * image, 0, 255).astype(np.uint8)


TOWEL, MARKER = cloth(1), cloth(2)


def pose(u: float, v: float, turn: float, scale: float, tilt: float = 0.0) -> NDArray[np.float64]:
    """A template's mapping: its middle at (u, v), turned, scaled, seen aslant."""
    middle = 0.5 * (SIDE - 1)
    c, s = scale * np.cos(turn), scale * np.sin(turn)
    back = np.array([[1.0, 0.0, -middle], [0.0, 1.0, -middle], [0.0, 0.0, 1.0]])
    return (
        np.array([[c, -s, u], [s, c, v], [0, 0, 1.0]]) @ [[1, 0, 0], [0, 1, 0], [tilt, 0, 1]] @ back
    )


def scene(
    things: list[tuple[NDArray[np.uint8], NDArray[np.float64]]], seed: int = 0
) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    background = cv2.resize(cloth(99, 500).astype(float), (900, 640))
    image = 90.0 + 0.4 * background
    for picture, H in things:
        inside = cv2.warpPerspective(np.ones_like(picture), H, (900, 640)) > 0
        drawn = cv2.warpPerspective(picture, H, (900, 640), flags=cv2.INTER_CUBIC)
        image[inside] = drawn[inside]
    image += 4.0 * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def templates() -> list[Template]:
    return [
        template(view(TOWEL, factor=1), "towel"),
        template(view(MARKER, factor=1), "marker"),
    ]


def found_in(image: NDArray[np.uint8], templates: list[Template]) -> tuple[Instance, ...]:
    return search(view(image, factor=1, most=4000), templates)


def check_found(instance: Instance, H: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(instance.corners, mapped(H, CORNERS), atol=1.5)


def test_instances_of_a_class_are_told_apart(templates: list[Template]) -> None:
    towels = [pose(150, 150, 0.4, 1.1), pose(420, 160, -2.0, 0.9, 5e-4), pose(700, 440, 1.5, 1.2)]
    markers = [pose(720, 150, 3.0, 0.8), pose(300, 480, -0.7, 1.3)]
    image = scene([(TOWEL, H) for H in towels] + [(MARKER, H) for H in markers])
    found = found_in(image, templates)
    assert sorted(instance.name for instance in found) == ["marker"] * 2 + ["towel"] * 3
    counts = [instance.inliers for instance in found]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 30
    for name, truths in (("towel", towels), ("marker", markers)):
        own = [instance for instance in found if instance.name == name]
        for H in truths:
            middle = mapped(H, np.full(2, 0.5 * (SIDE - 1)))
            check_found(min(own, key=lambda i: np.linalg.norm(i.centre - middle)), H)


def test_the_pose_is_stated(templates: list[Template]) -> None:
    (found,) = found_in(scene([(TOWEL, pose(400, 300, -2.3, 1.2))]), templates)
    assert found.turn == pytest.approx(-2.3, abs=0.01)
    assert found.scale == pytest.approx(1.2, abs=0.01)
    np.testing.assert_allclose(found.centre, [400, 300], atol=0.5)
    u0, v0, u1, v1 = found.box
    reach = 1.2 * 0.5 * (SIDE - 1) * (abs(np.cos(2.3)) + abs(np.sin(2.3)))
    np.testing.assert_allclose(
        [u0, v0, u1, v1], [400 - reach, 300 - reach, 400 + reach, 300 + reach], atol=2.0
    )


def test_two_that_touch_are_two(templates: list[Template]) -> None:
    beside = [pose(300, 300, 0.1, 1.0), pose(300 + SIDE + 4, 300, 0.1, 1.0)]
    found = found_in(scene([(TOWEL, H) for H in beside]), templates)
    assert len(found) == 2
    for H in beside:
        middle = mapped(H, np.full(2, 0.5 * (SIDE - 1)))
        check_found(min(found, key=lambda i: np.linalg.norm(i.centre - middle)), H)


def test_one_half_covered_or_half_outside_is_found(templates: list[Template]) -> None:
    covered, cover = pose(250, 250, 0.3, 1.1), pose(340, 260, 0.0, 1.0)
    outside = pose(880, 500, 1.0, 1.1)
    image = scene([(TOWEL, covered), (cloth(7), cover), (TOWEL, outside)])
    found = found_in(image, templates)
    assert [instance.name for instance in found] == ["towel", "towel"]
    for H in (covered, outside):
        middle = mapped(H, np.full(2, 0.5 * (SIDE - 1)))
        nearest = min(found, key=lambda i: np.linalg.norm(i.centre - middle))
        np.testing.assert_allclose(nearest.corners, mapped(H, CORNERS), atol=4.0)


@pytest.mark.parametrize("seed", range(3))
def test_where_nothing_is_nothing_is_found(templates: list[Template], seed: int) -> None:
    others = [
        (cloth(20 + seed), pose(200, 200, 0.4, 1.2)),
        (cloth(30 + seed), pose(600, 400, -1.0, 1.0)),
        (np.ascontiguousarray(TOWEL[:, ::-1]), pose(650, 150, 0.0, 1.0)),
    ]
    assert found_in(scene(others, seed), templates) == ()
    blank = np.full((300, 400), 128, dtype=np.uint8)
    assert search(view(blank), templates) == ()


def test_two_views_of_one_thing_find_it_once(templates: list[Template]) -> None:
    turned = cv2.warpPerspective(TOWEL, pose(79.5, 79.5, 0.5, 0.9), (SIDE, SIDE))
    second = template(view(np.asarray(turned), factor=1), "towel", box=(30, 30, 130, 130))
    found = found_in(scene([(TOWEL, pose(400, 300, 0.2, 1.1))]), [*templates, second])
    assert [instance.name for instance in found] == ["towel"]


def test_a_search_for_nothing_is_refused(templates: list[Template]) -> None:
    seen = view(scene([]))
    with pytest.raises(InputError, match="no template"):
        search(seen, [])
    with pytest.raises(InputError, match="3 matches determine nothing"):
        search(seen, templates, least=3)
