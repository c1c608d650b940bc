"""Range maps of captures: position, orientation, holes, and refused input."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from unwrinkle.models.errors import InputError, NoGarmentError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.range_mapping import Capture, load_capture, range_map_from_capture
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel, capture_of, overhead_pose
from unwrinkle.testing.table import GARMENT_CENTRE, TABLE

CAMERA = Camera("c", 640, 512, 900.0, 900.0, 319.5, 255.5, sensor="stereo")
TOWEL = Towel(
    ridges=(Ridge((0.10, -1.20), 0.0, 0.02, 0.012, 0.12),), side=0.36, waviness=0.0, yaw=0.0
)


@cache
def _made() -> Capture:
    return capture_of(TOWEL, CAMERA, overhead_pose(0.0, -1.1, 1.7), seed=1)


def _capture(**changes: object) -> Capture:
    made = _made()
    fields = {
        "depth": made.depth,
        "camera": made.camera,
        "colour": made.colour,
        "colour_registered": True,
        "X_WC": made.X_WC,
        "name": "made",
    }
    return Capture(**{**fields, **changes})  # type: ignore[arg-type]


def _top(range_map: RangeMap) -> np.ndarray:
    """Return the world x, y of the ridge: the centre of cells above 15 mm."""
    rows, columns = np.nonzero(range_map.height > 0.015)
    return range_map.world_from_cell(np.array([columns.mean(), rows.mean()]))


def _middle(range_map: RangeMap) -> np.ndarray:
    rows, columns = np.nonzero(range_map.garment)
    return range_map.world_from_cell(np.array([columns.mean(), rows.mean()]))


def test_with_a_pose_things_are_where_they_are() -> None:
    range_map = range_map_from_capture(_capture(), centre=GARMENT_CENTRE, table_height=TABLE.height)
    np.testing.assert_allclose(_top(range_map), (0.10, -1.20), atol=5e-4)
    np.testing.assert_allclose(_middle(range_map), (0.0, -1.1), atol=1e-3)
    assert range_map.table_height == pytest.approx(0.70, abs=1e-4)
    assert range_map.height.max() == pytest.approx(0.022, abs=5e-4)
    area = np.count_nonzero(range_map.garment) * range_map.resolution**2
    assert area == pytest.approx(0.36**2, rel=0.01)


def test_without_a_pose_the_garment_is_laid_at_the_default_place_unmirrored() -> None:
    """The image's top is away from the robot; seen from above, nothing is mirrored."""
    range_map = range_map_from_capture(
        _capture(X_WC=None), centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    np.testing.assert_allclose(_middle(range_map), (0.0, -1.1), atol=2e-3)
    np.testing.assert_allclose(_top(range_map), (0.10, -1.20), atol=3e-3)
    assert range_map.table_height == 0.70


def test_yaw_turns_the_garment_about_its_centre() -> None:
    turned = range_map_from_capture(
        _capture(X_WC=None), yaw=np.pi / 2.0, centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    # (0.10, -0.10) from the centre, turned a quarter to the left.
    np.testing.assert_allclose(_top(turned), (0.10, -1.00), atol=3e-3)
    np.testing.assert_allclose(_middle(turned), (0.0, -1.1), atol=2e-3)


def test_colour_lies_on_the_map() -> None:
    range_map = range_map_from_capture(_capture(), centre=GARMENT_CENTRE, table_height=TABLE.height)
    assert range_map.colour is not None
    inside = range_map.colour[range_map.garment].mean(axis=0)
    outside = range_map.colour[~range_map.garment & range_map.valid].mean(axis=0)
    assert inside[2] > inside[0] + 40.0  # blue cloth
    assert outside[0] > outside[2]  # on wood


def test_third_of_the_readings_missing_still_works() -> None:
    rng = np.random.default_rng(0)
    depth = np.array(_capture().depth)
    depth[rng.random(depth.shape) < 0.15] = np.nan
    for _ in range(60):
        row, column = rng.integers(0, depth.shape[0] - 40), rng.integers(0, depth.shape[1] - 40)
        depth[row : row + rng.integers(10, 40), column : column + rng.integers(10, 40)] = 0.0
    holes = np.mean(~(depth > 0.0))
    assert 0.2 < holes < 0.4
    whole = range_map_from_capture(_capture(), centre=GARMENT_CENTRE, table_height=TABLE.height)
    range_map = range_map_from_capture(
        _capture(depth=depth), centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    assert np.isfinite(range_map.height).all()
    assert (range_map.height[~range_map.valid] == 0.0).all()
    assert np.mean(range_map.valid[range_map.garment]) < 0.95
    areas = [np.count_nonzero(m.garment) for m in (range_map, whole)]
    assert areas[0] == pytest.approx(areas[1], rel=0.03)


def test_garment_hidden_by_holes_is_an_insufficient_view() -> None:
    depth = np.array(_capture().depth)
    # Every second column and row over the garment: three quarters of it, not half of the view.
    depth[90:420, 155:485][1::2] = 0.0
    depth[90:420, 155:485][:, 1::2] = 0.0
    with pytest.raises(InputError, match=r"made: insufficient view, 7\d% of the garment"):
        range_map_from_capture(
            _capture(depth=depth), centre=GARMENT_CENTRE, table_height=TABLE.height
        )


def test_pose_that_the_table_contradicts() -> None:
    X_WC = overhead_pose(0.0, -1.1, 1.7)
    lean = np.radians(10.0)
    X_WC[:3, :3] = X_WC[:3, :3] @ np.array(
        [[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]]
    )
    with pytest.raises(InputError, match=r"leans by 10\.0 degrees"):
        range_map_from_capture(
            _capture(X_WC=X_WC), centre=GARMENT_CENTRE, table_height=TABLE.height
        )


def test_bare_table_has_no_garment() -> None:
    with pytest.raises(NoGarmentError, match="made: no garment found"):
        range_map_from_capture(
            _capture(depth=np.full((512, 640), 1.0, dtype=np.float32)),
            centre=GARMENT_CENTRE,
            table_height=TABLE.height,
        )


def test_floor_beyond_the_table_is_no_reading_of_the_table() -> None:
    depth = np.array(_capture().depth)
    depth[:60] = 1.7
    range_map = range_map_from_capture(
        _capture(depth=depth), centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    far = range_map.origin[1] + range_map.resolution * np.arange(range_map.shape[0]) < -1.33
    assert not range_map.valid[far].any() or range_map.height[far].min() > -0.02
    assert range_map.height.min() > -0.02


def test_grid_is_made_coarser_than_a_coarse_camera(caplog: pytest.LogCaptureFixture) -> None:
    coarse = replace(CAMERA, width=320, height=256, fx=450.0, fy=450.0, cx=159.5, cy=127.5)
    capture = capture_of(TOWEL, coarse, overhead_pose(0.0, -1.1, 1.7))
    range_map = range_map_from_capture(capture, centre=GARMENT_CENTRE, table_height=TABLE.height)
    assert range_map.resolution == pytest.approx(0.0023)
    assert "coarser" in caplog.text
    assert range_map.valid[range_map.garment].mean() > 0.99


def test_same_capture_same_map() -> None:
    first, second = (
        range_map_from_capture(_capture(), seed=4, centre=GARMENT_CENTRE, table_height=TABLE.height)
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.height, second.height)
    np.testing.assert_array_equal(first.garment, second.garment)


REAL = {
    # Share of the depth image that the garment covers, judged by eye from the colour image.
    "20150625_2__dishcloth01_1": (0.08, 0.10),
    "20150625_2__polo01_1": (0.36, 0.41),
    "20150625__dishcloth01_1": (0.085, 0.105),
    "20150625__sweater01_1": (0.48, 0.54),
    "20150902__blanket01_3": (0.56, 0.62),
    "20150902__blanket01_3b": (0.50, 0.56),
    "20150902__towel01_1": (0.48, 0.54),
    "20150902__towel01_2": (0.39, 0.44),
    "20150902__towel02_2": (0.40, 0.45),
    "dishcloth01_1": (0.07, 0.09),
    "polo01_1": (0.32, 0.37),
    "robe01_1": (0.52, 0.57),
    "sweater02_1": (0.44, 0.50),
    "tshirt01_1": (0.34, 0.38),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_captures_of_uc3m(shared_data: object, name: str) -> None:
    path = f"{shared_data}/uc3m_textiles/{name}_fold_depth_mm.png"
    capture = load_capture(path, "xtion-pro-live")
    assert capture.colour is not None
    range_map = range_map_from_capture(capture, centre=GARMENT_CENTRE, table_height=TABLE.height)
    table = range_map.valid & ~range_map.garment
    assert abs(float(range_map.height[table].mean())) < 0.0006
    assert float(range_map.height[table].std()) < 0.004
    assert range_map.valid[range_map.garment].mean() > 0.98
    low, high = REAL[name]
    # Pixels lie distance / 525 apart on the table, at 0.99 to 1.06 m.
    share = np.count_nonzero(range_map.garment) * range_map.resolution**2 / (640 * 480)
    assert low * (0.98 / 525) ** 2 < share < high * (1.09 / 525) ** 2
    assert range_map.colour is not None


@pytest.mark.parametrize("number", ["00023", "01158", "02321"])
def test_real_captures_of_ctu(shared_data: object, number: str) -> None:
    path = f"{shared_data}/clopema_ctu_spread_garments/cloD{number}.png"
    range_map = range_map_from_capture(
        load_capture(path), centre=GARMENT_CENTRE, table_height=TABLE.height
    )
    assert range_map.colour is not None
    table = range_map.valid & ~range_map.garment
    assert abs(float(range_map.height[table].mean())) < 0.0006
    # Dark or grey cloth on light wood.
    inside = range_map.colour[range_map.garment].mean()
    assert inside < 0.9 * range_map.colour[table].mean()
