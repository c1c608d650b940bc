"""Synthetic towel: analytic ridges, captures, and the shipped file."""

import numpy as np
import pytest

from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.simulation.rendering.shipped_captures import SEED, towel_capture
from unwrinkle.simulation.rendering.synthetic_towel import (
    Ridge,
    Towel,
    capture_of,
    overhead_pose,
    sensor_noise,
    wrinkled_towel,
)
from unwrinkle.testing.table import GARMENT_CENTRE, TABLE

SHIPPED = models_dir() / "captures" / "towel.npz"


def test_ridge_is_a_gaussian_across_and_level_along() -> None:
    ridge = Ridge((0.1, -1.0), np.radians(30.0), 0.02, 0.01, 0.2)
    along, across = np.array([np.cos(np.pi / 6), 0.5]), np.array([-0.5, np.cos(np.pi / 6)])
    for u in (-0.06, 0.0, 0.06):
        for v in (0.0, 0.01, -0.017):
            x, y = np.array(ridge.centre) + u * along + v * across
            expected = 0.02 * np.exp(-0.5 * (v / 0.01) ** 2)
            assert ridge.at(np.array(x), np.array(y)) == pytest.approx(expected, rel=1e-9)
    ends = np.array(ridge.centre) + 0.1 * along
    assert ridge.at(*ends) == pytest.approx(0.01)
    gone = np.array(ridge.centre) + 0.13 * along
    assert ridge.at(*gone) == 0.0


def test_towel_rises_from_the_table_inside_its_outline() -> None:
    towel = Towel(ridges=(), side=0.4, waviness=0.0)
    x = np.array([0.0, 0.19, 0.25])
    y = np.full(3, -1.1)
    np.testing.assert_allclose(towel.height(x, y), [0.002, 0.002, 0.0])
    np.testing.assert_allclose(towel.edge_distance(x, y), [0.2, 0.01, -0.05], atol=1e-12)


def test_same_seed_same_towel() -> None:
    assert wrinkled_towel(3) == wrinkled_towel(3)
    assert wrinkled_towel(3) != wrinkled_towel(4)
    heights = [ridge.height * ridge.sigma * ridge.length for ridge in wrinkled_towel(3).ridges]
    assert heights[0] > 1.5 * heights[1] > 1.5 * heights[2]


def test_noise_has_the_size_asked_for() -> None:
    rng = np.random.default_rng(0)
    depth = np.full((200, 200), 1.0)
    depth[0, 0] = 0.0
    white = sensor_noise(depth, 0.0001, 0.0, rng)
    assert white[0, 0] == 0.0
    assert np.std(white[1:] - 1.0) == pytest.approx(0.0001, rel=0.05)
    stepped = sensor_noise(depth, 0.0018, 0.003, rng)
    assert np.std(stepped[1:] - 1.0) == pytest.approx(0.002, rel=0.2)
    assert np.ptp(np.diff(np.unique(1.0 / stepped[1:]))) < 1e-6


def _error(range_map: RangeMap, towel: Towel) -> np.ndarray:
    ny, nx = range_map.shape
    x, y = np.meshgrid(
        range_map.origin[0] + range_map.resolution * np.arange(nx),
        range_map.origin[1] + range_map.resolution * np.arange(ny),
    )
    return (range_map.height - towel.height(x, y))[range_map.valid]


def test_oblique_capture_gives_back_the_surface() -> None:
    """A camera off to one side: heights and places come out in the world all the same."""
    towel = wrinkled_towel(1)
    camera = Camera("c", 800, 640, 1400.0, 1400.0, 399.5, 319.5, sensor="stereo")
    lean = np.radians(12.0)
    X_WC = overhead_pose(0.0, 0.0, 0.0)
    tilt = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
    X_WC[:3, :3] = tilt @ X_WC[:3, :3]
    X_WC[:3, 3] = np.array([0.0, -1.1, 0.7]) - 1.35 * X_WC[:3, 2]
    capture = capture_of(towel, camera, X_WC, seed=5)
    range_map = range_map_from_capture(capture, centre=GARMENT_CENTRE, table_height=TABLE.height)
    error = _error(range_map, towel)
    assert abs(error.mean()) < 3e-5
    assert error.std() < 2.5e-4
    assert range_map.table_height == pytest.approx(0.70, abs=2e-4)


def test_shipped_capture_is_what_the_generator_makes() -> None:
    shipped = load_capture(SHIPPED)
    made = towel_capture()
    np.testing.assert_allclose(shipped.depth, made.depth, atol=0.00003)
    assert shipped.camera == made.camera
    np.testing.assert_array_equal(shipped.X_WC, made.X_WC)
    assert SHIPPED.stat().st_size < 2_000_000


def test_shipped_capture_measures_the_towel() -> None:
    towel = wrinkled_towel(SEED)
    range_map = range_map_from_capture(
        load_capture(SHIPPED), centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    error = _error(range_map, towel)
    assert abs(error.mean()) < 1e-5
    assert error.std() < 1.2e-4
    assert range_map.sensor == "stereo"
    assert range_map.resolution == 0.0005
    ny, nx = range_map.shape
    x, y = np.meshgrid(
        range_map.origin[0] + 0.0005 * np.arange(nx), range_map.origin[1] + 0.0005 * np.arange(ny)
    )
    truth = towel.edge_distance(x, y) > 0.0
    overlap = np.sum(truth & range_map.garment) / np.sum(truth | range_map.garment)
    assert overlap > 0.985
