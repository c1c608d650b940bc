"""Depth cameras in the rendered cell: captures that perception works with."""

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.range_mapping import range_map_from_capture, segment_capture
from unwrinkle.perception.depth.table_crop import crop_to_table
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.depth_cameras.cameras import depth_image, depth_reading, load_depth_camera
from unwrinkle.simulation.rendering.meshes import towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import (
    Ridge,
    Towel,
    overhead_pose,
    wrinkled_towel,
)

TOWEL = wrinkled_towel(0)
PLACE = (0.0, -1.10, 1.80)


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell()


@pytest.fixture(scope="module")
def scene(cell: Cell) -> Renderer:
    return Renderer(cell, [towel_mesh(TOWEL, spacing=0.002)], near=0.001)


def _cropped(cell: Cell, capture: Capture) -> Capture:
    return crop_to_table(capture, cell.table)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["xtion", "tof"])
@pytest.mark.filterwarnings("ignore:pixels lie")
def test_the_largest_wrinkle_is_found(scene: Renderer, cell: Cell, name: str) -> None:
    capture = depth_image(scene, load_depth_camera(name), overhead_pose(*PLACE), seed=0)
    found = analyse(
        range_map_from_capture(
            _cropped(cell, capture),
            centre=cell.scenario.garment_centre,
            table_height=cell.table.height,
        ),
        table=cell.table,
    )
    assert found.wrinkles
    largest, ridge = found.wrinkles[0], TOWEL.ridges[0]
    along = np.array([np.cos(ridge.angle), np.sin(ridge.angle)])
    offset = np.asarray(largest.centre)[:2] - ridge.centre
    assert abs(along[0] * offset[1] - along[1] * offset[0]) < 0.010
    assert abs(along @ np.asarray(largest.direction)[:2]) > np.cos(np.radians(8.0))
    assert largest.chord_height == pytest.approx(ridge.height * (1.0 - np.exp(-0.5)), rel=0.35)
    assert largest.width == pytest.approx(2.0 * ridge.sigma, rel=0.35)


@pytest.fixture(scope="module")
def ridged(cell: Cell) -> Capture:
    """A flat towel with one high ridge from edge to edge, seen by the Xtion."""
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.95, 0.024, 0.009, 0.5),), side=0.5)
    scene = Renderer(cell, [towel_mesh(towel, spacing=0.002)])
    return _cropped(cell, depth_image(scene, load_depth_camera("xtion"), overhead_pose(*PLACE), 3))


@pytest.mark.parametrize("seed", range(8))
def test_a_ridge_alone_is_not_taken_for_the_garment(ridged: Capture, seed: int) -> None:
    _, found = segment_capture(ridged, noise_profile("xtion"), seed=seed)
    area = np.count_nonzero(found.garment) * (1.1 / 525.0) ** 2
    assert area == pytest.approx(0.25, rel=0.1)


def test_the_capture_has_pose_colour_and_depth(scene: Renderer, cell: Cell) -> None:
    model = load_depth_camera("xtion")
    X_WC = overhead_pose(*PLACE)
    capture = depth_image(scene, model, X_WC, seed=3)
    assert np.array_equal(capture.depth, depth_reading(scene, model, X_WC, 3))
    assert capture.X_WC is not None and np.array_equal(capture.X_WC, X_WC)
    assert capture.camera == model.camera
    assert capture.colour is not None and capture.colour_registered
    # Registered: the towel's grey-blue lies where depth is nearer than the table by its ridges.
    high = (capture.depth > 0.0) & (capture.depth < 1.085)
    assert np.count_nonzero(high) > 300
    blue = capture.colour[..., 2].astype(int) - capture.colour[..., 0]
    assert np.mean(blue[high] > 0) > 0.9
    exact = scene.depth(model.camera, X_WC)
    on = (capture.depth > 0.0) & (exact > 1.0) & (exact < 1.2)
    error = np.abs(capture.depth[on] - exact[on])
    assert 0.0005 < np.median(error) < 0.003
    assert np.mean(error > 0.02) < 0.01  # edges wander


@pytest.mark.parametrize("name", ["xtion", "tof"])
def test_inside_the_cloth_there_is_no_reading(scene: Renderer, name: str) -> None:
    X_WC = overhead_pose(0.0, -1.10, 0.703)
    model = load_depth_camera(name)
    reading = depth_reading(scene, model, X_WC, 0)
    assert np.isfinite(reading).all()
    assert not reading.any()
    with pytest.raises(InputError, match=f"{name}: depth is all zero"):
        depth_image(scene, model, X_WC, 0)


def test_nothing_in_view_is_said(scene: Renderer) -> None:
    up = overhead_pose(*PLACE) @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert not depth_reading(scene, load_depth_camera("tof"), up, 0).any()
    with pytest.raises(InputError, match="all zero"):
        depth_image(scene, load_depth_camera("xtion"), up, 0)


def test_the_floor_is_cropped_away(scene: Renderer, cell: Cell) -> None:
    capture = depth_image(scene, load_depth_camera("xtion"), overhead_pose(*PLACE), seed=0)
    assert np.mean(capture.depth > 1.5) > 0.4  # the floor fills more than the table
    cropped = _cropped(cell, capture)
    assert not (cropped.depth > 1.2).any()
    found = range_map_from_capture(
        cropped, centre=cell.scenario.garment_centre, table_height=cell.table.height
    )
    assert found.table_height == pytest.approx(0.70, abs=0.004)
    assert found.garment.sum() * found.resolution**2 == pytest.approx(0.23, abs=0.03)
