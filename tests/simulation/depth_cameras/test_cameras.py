"""Depth camera models on exact depth images, and their files."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera, load_camera
from unwrinkle.simulation.depth_cameras._base import incidence
from unwrinkle.simulation.depth_cameras.cameras import (
    DepthCameraModel,
    StructuredLightCamera,
    TimeOfFlightCamera,
    depth_camera_names,
    load_depth_camera,
)

SMALL = Camera("small", 160, 120, 525.0, 525.0, 79.5, 59.5)


def _xtion(**changes: object) -> StructuredLightCamera:
    model = load_depth_camera("xtion")
    assert isinstance(model, StructuredLightCamera)
    return dc.replace(model, camera=SMALL, **changes)  # type: ignore[arg-type]


def _quiet(**changes: object) -> StructuredLightCamera:
    """Without noise and bias."""
    none = {"window_noise": 0.0, "blotch_noise": 0.0, "edge_noise": 0.0, "band_spread": 0.0}
    return _xtion(**{**none, "bow": [0.0, 0.0, 0.0], **changes})


def _tof(**changes: object) -> TimeOfFlightCamera:
    model = load_depth_camera("tof")
    assert isinstance(model, TimeOfFlightCamera)
    return dc.replace(model, **changes)  # type: ignore[arg-type]


def _still(**changes: object) -> TimeOfFlightCamera:
    return _tof(**{"range_noise": 0.0, "pixel_offsets": 0.0, **changes})


def _wall(model: DepthCameraModel, depth: float) -> NDArray[np.float64]:
    camera = model.ideal_camera
    return np.full((camera.height, camera.width), depth)


def _leaning(model: DepthCameraModel, depth: float, angle: float) -> NDArray[np.float64]:
    """A plane at a depth on the axis that leans about the camera's y axis by degrees."""
    x, _ = model.ideal_camera.rays()
    return depth / (1.0 - x * np.tan(np.radians(angle)))


# Structured light


def test_readings_are_steps_of_disparity() -> None:
    """3 mm apart at 1 m, growing with the square of depth."""
    model = _quiet()
    camera = model.ideal_camera
    depth = np.tile(np.linspace(0.9, 2.1, camera.height)[:, None], (1, camera.width))
    levels = np.unique(model.measured(depth, 0)[:, 20:])
    apart, middle = np.diff(levels), 0.5 * (levels[1:] + levels[:-1])
    # Where the plane passes several steps from row to row, levels lie some steps apart.
    steps = apart / (middle**2 * model.inverse_step)
    assert np.abs(steps - np.rint(steps)).max() < 0.25  # millimetres are rounded to
    assert steps.min() > 0.7
    near_one = model.measured(_leaning(model, 1.0, 12.0), 0)[:, 20:]
    apart = np.diff(np.unique(near_one))
    assert 0.0026 < np.mean(apart) < 0.0032


def test_noise_grows_with_the_square_of_depth() -> None:
    """1.4 to 2.2 mm at 1 m (Khoshelham 1.43, Nguyen 1.88, with their steps), four times at 2 m."""
    model = _xtion()

    def spread(depth: float) -> float:
        looks = np.stack([model.measured(_wall(model, depth), k) for k in range(8)])
        return float(np.sqrt(looks[:, 10:-10, 20:-10].astype(float).var(axis=0).mean()))

    assert 0.0014 < spread(1.0) < 0.0022
    assert spread(2.0) / spread(1.0) == pytest.approx(4.0, rel=0.15)


def test_noise_is_alike_over_the_window() -> None:
    model = _xtion(blotch_noise=0.0, band_spread=0.0, bow=[0.0, 0.0, 0.0], window_noise=1.5)
    error = model.measured(_wall(model, 1.0), 3)[8:-8, 20:-8].astype(float)
    error -= error.mean()

    def alike(lag: int) -> float:
        return float((error[:, lag:] * error[:, :-lag]).mean() / error.var())

    assert alike(1) > 0.75
    assert alike(4) == pytest.approx(5.0 / 9.0, abs=0.12)
    assert abs(alike(14)) < 0.2


@pytest.mark.parametrize("near", [0.85, 0.95])
def test_the_projectors_shadow_lies_left_of_what_is_nearer(near: float) -> None:
    model = _quiet(window=1, blind_columns=0)
    depth = _wall(model, 1.2)
    depth[:, 70:110] = near
    reading = model.measured(depth, 0)
    width = model.camera.fx * model.baseline * (1.0 / near - 1.0 / 1.2)
    holes = np.nonzero(reading[60] == 0.0)[0]
    assert len(holes) == pytest.approx(width, abs=1.0)
    assert holes.max() == 69
    assert holes.min() == 70 - len(holes)


def test_a_shadow_comes_in_from_outside_the_image() -> None:
    model = _quiet(window=1, blind_columns=0)
    depth = _wall(model, 1.2)
    depth[:, SMALL.width + 2 :] = 0.85
    assert (model.measured(depth, 0)[:, -3:] == 0.0).all()


def test_windows_close_small_shadows_and_not_large_ones() -> None:
    model = _quiet(blind_columns=0)
    low, high = _wall(model, 1.10), _wall(model, 1.10)
    low[:, 60:100] = 1.08  # a hem: 0.7 px of shadow
    high[:, 60:100] = 0.85
    assert (model.measured(low, 0) > 0.0).all()
    assert (model.measured(high, 0)[60, 50:60] == 0.0).any()


def test_the_surface_that_fills_the_window_wins() -> None:
    """Never a reading between the two: no flying pixels."""
    model = _xtion()
    depth = _wall(model, 1.2)
    depth[:, 70:110] = 0.9
    reading = model.measured(depth, 1)
    between = (reading > 0.95) & (reading < 1.15)
    assert not between.any()
    assert (reading == 0.0).mean() < 0.15


@pytest.mark.parametrize(("angle", "read"), [(60.0, True), (-60.0, True), (80.0, False)])
def test_steep_faces_give_no_reading(angle: float, read: bool) -> None:
    model = _quiet()
    reading = model.measured(_leaning(model, 1.2, angle), 0)
    assert bool((reading[60, 70:90] > 0.0).all()) is read


def test_faces_turned_from_the_projector_drop_out_first() -> None:
    """The projector stands on the right: a face that looks left is steeper to it."""
    model = _quiet(steepest=63.5)
    # Where z grows to the right, the face looks right.
    right = model.measured(_leaning(model, 1.0, 61.0), 0)[60, 74:86]
    left = model.measured(_leaning(model, 1.0, -61.0), 0)[60, 74:86]
    assert (right > 0.0).all()
    assert (left == 0.0).all()


def test_bands_belong_to_the_specimen() -> None:
    depth = _wall(_xtion(), 1.0)

    def columns(model: StructuredLightCamera, seed: int) -> NDArray[np.float64]:
        return np.asarray(model.measured(depth, seed)[:, 10:].mean(axis=0), dtype=float)

    calm = {"window_noise": 0.3, "blotch_noise": 0.0, "band_width": 30.0}
    one, other = _xtion(unit=1, **calm), _xtion(unit=2, **calm)
    same = np.corrcoef(columns(one, 5), columns(one, 6))[0, 1]
    different = np.corrcoef(columns(one, 5), columns(other, 5))[0, 1]
    assert same > 0.9
    assert different < 0.7


def test_the_left_columns_are_blind() -> None:
    reading = _xtion().measured(_wall(_xtion(), 1.0), 0)
    assert (reading[:, :7] == 0.0).all()
    assert (reading[:, 7:] > 0.0).all()


# Time of flight


def test_an_exact_wall_is_read_exactly() -> None:
    error = np.abs(_still().measured(_wall(_still(), 1.3), 0) - 1.3)
    assert error[2:-2, 2:-2].max() < 1e-5
    assert error.max() < 5e-4  # the blur lacks what is outside the image


def test_pixels_fly_between_near_and_far() -> None:
    model = _still(blur=0.0)
    depth = _wall(model, 1.0)
    depth[:, : 100 * 4 + 2] = 0.7  # half of column 100
    reading = model.measured(depth, 0)[100]
    assert np.abs(reading[:100] - 0.7).max() < 1e-3
    assert np.abs(reading[101:] - 1.0).max() < 1e-3
    # Amplitudes 1/0.49 and 1: the near one weighs twice.
    assert reading[100] == pytest.approx((0.7 / 0.49 + 1.0) / (1.0 / 0.49 + 1.0), abs=0.005)


def test_blur_makes_more_pixels_fly() -> None:
    def flying(blur: float) -> int:
        model = _still(blur=blur)
        depth = _wall(model, 1.0)
        depth[:, :400] = 0.7
        row = model.measured(depth, 0)[100]
        return int(np.count_nonzero((row > 0.72) & (row < 0.98)))

    assert flying(0.0) == 0
    assert 1 <= flying(0.5) <= 3


def test_noise_grows_as_the_amplitude_falls() -> None:
    model = _tof(pixel_offsets=0.0, oversampling=1)

    def spread(depth: NDArray[np.float64]) -> float:
        looks = np.stack([model.measured(depth, k)[90:110, 90:110] for k in range(12)])
        return float(np.sqrt(looks.astype(float).var(axis=0).mean()))

    at_one = spread(_wall(model, 1.0))
    assert at_one == pytest.approx(model.range_noise, rel=0.1)
    # Twice the distance is a quarter of the amplitude, 5/8 of the background: 3.16 times.
    assert spread(_wall(model, 2.0)) / at_one == pytest.approx(4.0 * np.sqrt(0.625), rel=0.15)
    assert spread(_leaning(model, 1.0, 60.0)) / at_one > 1.5


def test_it_works_from_20_cm() -> None:
    model = _tof()
    assert (model.measured(_wall(model, 0.25), 0) > 0.0).mean() == 1.0
    assert not model.measured(_wall(model, 0.15), 0).any()
    assert not _xtion().measured(_wall(_xtion(), 0.25), 0).any()


def test_the_pixels_offsets_stay() -> None:
    model = _tof(range_noise=0.0, oversampling=1)
    depth = _wall(model, 1.0)
    first, second = model.measured(depth, 1), model.measured(depth, 2)
    assert np.array_equal(first, second)
    assert float(first.std()) == pytest.approx(0.001, rel=0.15)


# Both


@pytest.mark.parametrize("name", ["xtion", "tof"])
def test_one_seed_one_look(name: str) -> None:
    model = load_depth_camera(name)
    depth = _wall(model, 1.1)
    first = model.measured(depth, 4)
    assert np.array_equal(first, model.measured(depth, 4))
    assert not np.array_equal(first, model.measured(depth, 5))


@pytest.mark.parametrize("name", ["xtion", "tof"])
@pytest.mark.parametrize("depth", [0.0, np.nan, np.inf, 0.05, 30.0])
def test_nothing_in_range_is_zero_and_never_nan(name: str, depth: float) -> None:
    model = load_depth_camera(name)
    reading = model.measured(_wall(model, depth), 0)
    assert reading.dtype == np.float32
    assert reading.shape == (model.camera.height, model.camera.width)
    assert not reading.any()


@pytest.mark.parametrize("name", ["xtion", "tof"])
def test_depth_of_another_size_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"shape \(10, 10\), wanted"):
        load_depth_camera(name).measured(np.ones((10, 10)), 0)


def test_incidence_of_planes_is_exact() -> None:
    x, y = SMALL.rays()
    normal = np.array([0.3, -0.5, -1.0]) / np.sqrt(1.34)
    depth = -0.9 / (normal[0] * x + normal[1] * y + normal[2])
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    wanted = -(rays @ normal) / np.linalg.norm(rays, axis=-1)
    assert np.abs(incidence(depth, SMALL) - wanted).max() < 1e-6
    points = rays * depth[..., None] - [0.075, 0.0, 0.0]
    wanted = -(points @ normal) / np.linalg.norm(points, axis=-1)
    assert np.abs(incidence(depth, SMALL, 0.075) - wanted).max() < 1e-6


def test_the_shipped_cameras() -> None:
    assert set(depth_camera_names()) == {"xtion", "tof"}
    xtion, tof = load_depth_camera("xtion"), load_depth_camera("tof")
    assert xtion.camera == load_camera("xtion-pro-live")
    assert (tof.camera.width, tof.camera.height, tof.camera.sensor) == (200, 200, "tof")
    assert 2.0 * np.degrees(np.arctan(100.0 / tof.camera.fx)) == pytest.approx(40.0, abs=0.1)
    assert tof.nearest == 0.2
    assert tof.near_plane < tof.nearest


CAMERA_KEY = "camera: {name: c, width: 200, height: 200, fx: 270.0, fy: 270.0, cx: 99.5, cy: 99.5"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("laser: {name: a}", "structured_light or time_of_flight; it has laser"),
        ("structured_light: {}\ntime_of_flight: {}", "one key at the root"),
        ("", "it has none"),
        ("time_of_flight: [1", "YAML"),
        ("time_of_flight: {name: a}", "image size 0 x 0"),
        ("time_of_flight: {CAMERA, distortion: [0.1, 0.0, 0.0, 0.0]}}", "has distortion"),
        ("structured_light: {CAMERA}, colour: red}", "colour"),
        ("structured_light: {CAMERA}, nearest: 5.0}", "range 5.0 to 4.0 m is empty"),
        ("structured_light: {CAMERA}, window: 8}", "window = 8 must be odd"),
        ("structured_light: {CAMERA}, bow: [1.0]}", "three finite numbers"),
        ("structured_light: {CAMERA}, inverse_step: .nan}", "inverse_step = nan"),
        ("structured_light: {CAMERA}, inverse_step: 0.0}", "must be positive"),
        ("structured_light: {CAMERA}, baseline: -0.1}", "baseline = -0.1"),
        ("structured_light: {CAMERA}, matched: 1.5}", "matched = 1.5"),
        ("structured_light: {CAMERA}, band_width: 2.0}", "band_width must be 8"),
        ("time_of_flight: {CAMERA}, farthest: 8.0}", "repeat after 7.49 m"),
        ("time_of_flight: {CAMERA}, modulation: 0.0}", "repeat after 0.00 m"),
        ("time_of_flight: {CAMERA}, oversampling: 0}", "oversampling = 0"),
    ],
)
def test_files_that_describe_no_camera(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text.replace("CAMERA", CAMERA_KEY))
    with pytest.raises(InputError, match=message) as caught:
        load_depth_camera(path)
    assert "camera.yaml" in str(caught.value)


def test_unknown_names_and_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="known are tof, xtion"):
        load_depth_camera("kinect")
    with pytest.raises(InputError, match="no such file"):
        load_depth_camera(tmp_path / "none.yaml")
