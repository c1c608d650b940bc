"""Whole scenes: a cloth with one ridge, beside the floor, objects, and readings that are none."""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from unwrinkle.models.errors import InputError, SeveralGarmentsError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.color_registration import registered_colour
from unwrinkle.perception.depth.flying_pixels import without_flying_pixels
from unwrinkle.perception.depth.range_mapping import Capture, range_map_from_capture
from unwrinkle.perception.depth.table_crop import crop_to_region
from unwrinkle.perception.range_map import RangeMap

CAMERA = Camera("c", 320, 240, 262.0, 262.0, 159.5, 119.5, sensor="stereo")
AREA = 0.5 * 0.4

#: Heights (h, w), metres, of places x, y (h, w) on a table.
Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _cloth(x: np.ndarray, y: np.ndarray, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Return a cloth of 0.5 x 0.4 m, 3 mm thick, with a ridge of 25 mm."""
    x, y = x - at[0], y - at[1]
    inside = (np.abs(x) < 0.25) & (np.abs(y) < 0.2)
    ridge = 0.025 * np.exp(-0.5 * (y / 0.015) ** 2) * (np.abs(x) < 0.15)
    return np.where(inside, 0.003 + ridge, 0.0)


def _depth(
    heights: Heights = _cloth,
    distance: float = 1.0,
    boxes: Sequence[tuple[float, ...]] = (),
) -> np.ndarray:
    """Return the depth image of a scene seen straight from above.

    Args:
        heights: of what lies on the ground.
        distance: of the ground, metres.
        boxes: x from and to, y from and to, height above the ground, metres.
    """
    x, y = CAMERA.rays()
    depth = np.full(x.shape, distance)
    for _ in range(3):  # a point of height h is seen at its ray times distance - h
        depth = distance - heights(x * depth, y * depth)
    for x0, x1, y0, y1, height in boxes:
        top = distance - height
        on = (x * top > x0) & (x * top < x1) & (y * top > y0) & (y * top < y1)
        depth = np.where(on, np.minimum(depth, top), depth)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, depth.shape)
    return np.asarray(depth + noise, dtype=np.float32)


def _map(capture: Capture | np.ndarray) -> RangeMap:
    if not isinstance(capture, Capture):
        capture = Capture(capture, CAMERA, name="scene")
    return range_map_from_capture(capture, centre=(0.0, -1.1), table_height=0.7)


def _area(found: RangeMap) -> float:
    return float(found.garment.sum() * found.resolution**2)


def _peak(found: RangeMap) -> float:
    return float(np.quantile(found.height[found.garment & found.valid], 0.999))


def _check(found: RangeMap) -> None:
    assert _area(found) == pytest.approx(AREA, rel=0.04)
    assert _peak(found) == pytest.approx(0.028, abs=0.002)


def test_the_scene_itself() -> None:
    _check(_map(_depth()))


def _scattered(value: float | None, share: float) -> np.ndarray:
    depth = _depth()
    rng = np.random.default_rng(1)
    hit = rng.random(depth.shape) < share
    far = rng.uniform(0.4, 6.0, depth.shape) if value is None else np.full(depth.shape, value)
    return np.where(hit, far, depth).astype(np.float32)


@pytest.mark.parametrize(
    ("value", "share"),
    [(0.0, 0.05), (65.535, 0.05), (1e10, 0.05), (10.0, 0.05), (4.095, 0.05), (2.047, 0.02)],
)
def test_readings_that_are_none(value: float, share: float) -> None:
    _check(_map(_scattered(value, share)))


@pytest.mark.parametrize("share", [0.002, 0.01, 0.03])
def test_flying_pixels_are_removed_before_smoothing(share: float) -> None:
    _check(_map(_scattered(None, share)))


def test_a_band_and_a_blob_of_far_readings_are_left_out() -> None:
    depth = _depth()
    depth[:30] = 4.0
    depth[200:230, 10:60] = 9.9
    _check(_map(depth))


def test_flying_pixels_of_a_clean_image_are_none() -> None:
    depth = _depth()
    cleaned, share = without_flying_pixels(depth, 1e-4)
    assert cleaned is depth
    assert share == 0.0
    depth[100:140, 100:140] = 0.0  # the rim of a hole stays
    assert without_flying_pixels(depth, 1e-4)[1] == 0.0
    depth[50, 50:54] = 0.8  # a thin thing, one pixel wide
    assert without_flying_pixels(depth, 1e-4)[1] == pytest.approx(4 / np.sum(depth > 0))


@pytest.mark.parametrize(
    "box",
    [
        (0.36, 0.55, -0.5, 0.5, 0.25),  # a gripper along the side
        (-0.6, -0.4, -0.1, 0.3, 0.30),
        (-0.2, 0.3, 0.2, 0.25, 0.40),
        (0.25, 0.29, 0.15, 0.2, 0.5),
    ],
)
def test_an_object_higher_than_a_garment_is_left_out(
    box: tuple[float, ...], caplog: pytest.LogCaptureFixture
) -> None:
    _check(_map(_depth(boxes=[box])))
    assert "above the table" in caplog.text


@pytest.mark.parametrize("height", [0.02, 0.08, 0.15])
def test_a_second_piece_asks_for_a_pixel(height: float) -> None:
    depth = _depth(boxes=[(0.36, 0.55, -0.3, 0.3, height)])
    with pytest.raises(SeveralGarmentsError, match=r"--at \d+,\d+"):
        _map(depth)
    capture = Capture(depth, CAMERA, name="scene", garment_at=(160, 120))
    _check(_map(capture))
    with pytest.raises(SeveralGarmentsError, match="nothing stands above"):
        _map(dc.replace(capture, garment_at=(20, 20)))
    with pytest.raises(SeveralGarmentsError, match="outside"):
        _map(dc.replace(capture, garment_at=(400, 20)))
    _check(_map(crop_to_region(Capture(depth, CAMERA), (0, 0, 245, 240))))


def test_two_garments_of_which_the_smaller_is_meant() -> None:
    def two(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        small = (np.abs(x + 0.45) < 0.13) & (np.abs(y) < 0.15)
        return np.where(small, 0.01, _cloth(x, y, (0.15, 0.0)))

    depth = _depth(two)
    with pytest.raises(SeveralGarmentsError, match="2 pieces"):
        _map(depth)
    found = _map(Capture(depth, CAMERA, garment_at=(42, 120)))
    assert _area(found) == pytest.approx(0.26 * 0.30, rel=0.08)


def test_a_crumb_beside_the_garment_does_not_matter() -> None:
    _check(_map(_depth(boxes=[(0.4, 0.43, 0.1, 0.13, 0.02)])))


@pytest.mark.parametrize("height", [0.3, 0.6])
def test_an_object_that_touches_the_garment_is_refused(height: float) -> None:
    with pytest.raises(SeveralGarmentsError, match="touches"):
        _map(_depth(lambda x, y: 0.04 * (_cloth(x, y) > 0), boxes=[(0.08, 0.3, -0.1, 0.1, height)]))


def _on_a_table(width: float, boxes: Sequence[tuple[float, ...]] = ()) -> np.ndarray:
    """Return a scene on a small table 0.7 m above the floor, the camera 1.2 m above it."""
    x, y = CAMERA.rays()
    top = (np.abs(1.2 * x) < width / 2) & (np.abs(1.2 * y) < width / 2)
    return np.where(top, _depth(distance=1.2), _depth(lambda x, y: 0.0 * x, 1.9, boxes))


@pytest.mark.parametrize("width", [0.62, 0.8])
def test_the_table_is_the_plane_with_the_garment(
    width: float, caplog: pytest.LogCaptureFixture
) -> None:
    found = _map(_on_a_table(width))
    assert _area(found) == pytest.approx(AREA, rel=0.06)
    assert _peak(found) == pytest.approx(0.028, abs=0.003)
    if width < 0.7:
        assert "level planes" in caplog.text


def test_things_on_both_planes_are_asked_for() -> None:
    with pytest.raises(SeveralGarmentsError, match="--region"):
        _map(_on_a_table(0.62, boxes=[(0.6, 0.9, -0.2, 0.2, 0.1)]))


def test_a_region_must_lie_in_the_image() -> None:
    capture = Capture(_depth(), CAMERA, name="scene")
    for region in ((0, 0, 400, 100), (50, 50, 40, 90), (-1, 0, 100, 100), (0, 0, 10, 10)):
        with pytest.raises(InputError, match="region"):
            crop_to_region(capture, region)
    window = crop_to_region(capture, (40, 30, 280, 210))
    assert window.camera.crop == [40, 30, 320, 240]
    _check(_map(window))


COLOUR = Camera("rgb", 640, 480, 440.0, 440.0, 319.5, 239.5)
X_DC = np.eye(4)
X_DC[:3, 3] = (0.03, 0.0, 0.002)


def _thin(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a cloth whose flat part no camera tells from the table by depth."""
    return np.where(_cloth(x, y) > 0, _cloth(x, y) - 0.0027, 0.0)


def _picture(camera: Camera, X: np.ndarray) -> np.ndarray:
    """Return the colour image of a cloth on a table 1 m below a camera at pose X."""
    x, y = camera.rays()
    inside = _cloth(x + X[0, 3], y + X[1, 3]) > 0
    noise = np.random.default_rng(2).normal(0.0, 4.0, (*x.shape, 3))
    base = np.where(inside[..., None], (60.0, 90.0, 150.0), (200.0, 195.0, 180.0))
    return np.clip(base + noise, 0, 255).astype(np.uint8)


def test_the_colour_cameras_geometry_registers_its_image() -> None:
    depth, picture = _depth(_thin), _picture(COLOUR, X_DC)
    depth[60:70, 60:70] = 0.0
    seen = registered_colour(picture, depth, CAMERA, COLOUR, X_DC)
    truth = _cloth(*CAMERA.rays()) > 0
    blue = seen[..., 2].astype(int) > seen[..., 0]
    assert np.mean(blue == truth) > 0.99
    found = _map(Capture(depth, CAMERA, seen, True, name="scene"))
    assert _area(found) == pytest.approx(AREA, rel=0.04)


@pytest.mark.parametrize("focal", [0.62, 0.75, 1.0, 1.45])
def test_unregistered_colour_is_right_or_not_used(
    focal: float, caplog: pytest.LogCaptureFixture
) -> None:
    camera = Camera("rgb", 640, 480, 524.0 * focal, 524.0 * focal, 319.5, 239.5)
    picture = _picture(camera, np.eye(4))
    xtion = dc.replace(CAMERA, sensor="xtion")
    thick = _depth(lambda x, y: np.where(_cloth(x, y) > 0, _cloth(x, y) + 0.007, 0.0))
    found = _map(Capture(thick, xtion, picture, name="scene"))
    if "colour image is not used" not in caplog.text:
        assert found.colour is not None
    assert _area(found) == pytest.approx(AREA, rel=0.12)


def test_colour_that_is_not_used_is_said(caplog: pytest.LogCaptureFixture) -> None:
    noise = np.random.default_rng(3).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    found = _map(Capture(_depth(), CAMERA, noise, name="scene"))
    assert found.colour is None
    assert "colour image is not used" in caplog.text


@pytest.mark.parametrize("thickness", [0.0055, 0.006, 0.007])
def test_thick_cloth_with_one_high_fold_is_found(thickness: float) -> None:
    xtion = dc.replace(CAMERA, sensor="xtion")

    def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where(_cloth(x, y) > 0, _cloth(x, y) - 0.003 + thickness, 0.0)

    depth = np.round(_depth(heights), 3)
    found = _map(Capture(depth, xtion, name="scene"))
    assert _area(found) == pytest.approx(AREA, rel=0.15)
