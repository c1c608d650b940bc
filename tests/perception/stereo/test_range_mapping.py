"""Range maps of image pairs: accuracy, small angle errors, and refused input."""

import dataclasses
import dataclasses as dc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.testing.table import TABLE

STEP = 0.00022439959992278893


@pytest.fixture(scope="module")
def towel_map(seen_towel: Any) -> RangeMap:
    return range_map_from_pair(seen_towel.pair, seen_towel.head, seen_towel.gaze, table=TABLE)


def errors(seen: Any, range_map: RangeMap, rim: float = 0.012) -> NDArray[np.float64]:
    rows, columns = np.indices(range_map.shape)
    cells = range_map.world_from_cell(np.stack([columns, rows], axis=-1).astype(float))
    x, y = cells[..., 0], cells[..., 1]
    cloth = (seen.towel.edge_distance(x, y) > rim) & range_map.valid
    assert np.count_nonzero(cloth) > 0.97 * np.count_nonzero(seen.towel.edge_distance(x, y) > rim)
    error: NDArray[np.float64] = (range_map.height - seen.towel.height(x, y))[cloth]
    return error


def test_heights_are_where_and_what_they_are(seen_towel: Any, towel_map: RangeMap) -> None:
    # A quarter of the resolution: one pixel of disparity is 8 mm of height.
    error = errors(seen_towel, towel_map)
    assert np.sqrt(np.mean(error**2)) < 0.0010
    assert abs(float(np.mean(error))) < 0.0003
    assert towel_map.sensor == "stereo-head"
    assert towel_map.table_height == 0.70


def test_the_garments_mask_is_the_towel(seen_towel: Any, towel_map: RangeMap) -> None:
    rows, columns = np.indices(towel_map.shape)
    cells = towel_map.world_from_cell(np.stack([columns, rows], axis=-1).astype(float))
    towel = seen_towel.towel.edge_distance(cells[..., 0], cells[..., 1]) > 0.0
    overlap = np.count_nonzero(towel & towel_map.garment)
    assert overlap > 0.97 * np.count_nonzero(towel | towel_map.garment)
    assert towel_map.colour is not None
    assert towel_map.colour[towel].mean(axis=0)[2] > towel_map.colour[towel].mean(axis=0)[0] + 40.0


@pytest.mark.parametrize(
    "angles", [{"right_tilt": 2 * STEP}, {"left_pan": 2 * STEP}, {"right_pan": -3 * STEP}]
)
def test_a_few_steps_of_a_unit_do_little_harm(seen_towel: Any, angles: dict[str, float]) -> None:
    # Tilt shows in the rows, pan in the height of the known table; both are taken out.
    off = {name: getattr(seen_towel.gaze, name) + by for name, by in angles.items()}
    gaze = dataclasses.replace(seen_towel.gaze, **off)
    error = errors(
        seen_towel, range_map_from_pair(seen_towel.pair, seen_towel.head, gaze, table=TABLE)
    )
    assert np.sqrt(np.mean(error**2)) < 0.0013


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        ({"right_pan": 0.006}, r"by the head's angles the table (is at|leans)|out of step"),
        ({"left_pan": -0.02, "right_pan": 0.02}, r"table (is at|leans)|out of step|matched"),
        ({"left_tilt": 0.3, "right_tilt": 0.3}, "does not look at the working table"),
        ({"ext_axis": 1.0}, "does not look at the working table"),
        ({"left_tilt": -0.6}, "left eye: tilt .* beyond its limits"),
    ],
)
def test_wrong_angles_never_make_a_map(
    seen_towel: Any, angles: dict[str, float], message: str
) -> None:
    off = {name: getattr(seen_towel.gaze, name) + by for name, by in angles.items()}
    gaze = dataclasses.replace(seen_towel.gaze, **off)
    with pytest.raises(InputError, match=message) as caught:
        range_map_from_pair(seen_towel.pair, seen_towel.head, gaze, table=TABLE)
    assert "\n" not in str(caught.value)


def test_a_garment_that_covers_most_of_the_table_is_not_the_table(seen_towel: Any) -> None:
    small = dc.replace(TABLE, centre=(0.0, -1.10), size=(0.58, 0.58))
    range_map = range_map_from_pair(seen_towel.pair, seen_towel.head, seen_towel.gaze, table=small)
    error = errors(seen_towel, range_map)
    assert abs(float(np.median(error))) < 0.0005
    assert np.sqrt(np.mean(error**2)) < 0.0012


def test_a_table_of_another_height_is_refused(seen_towel: Any) -> None:
    table = dc.replace(TABLE, height=0.76)
    with pytest.raises(InputError, match=r"table is at 0\.70\d m, the cell has it at 0\.760 m"):
        range_map_from_pair(seen_towel.pair, seen_towel.head, seen_towel.gaze, table=table)


def test_an_eye_that_sees_something_else_is_refused(seen_towel: Any) -> None:
    rng = np.random.default_rng(0)
    shape = seen_towel.pair.left.shape
    other = rng.integers(60, 190, shape, dtype=np.uint8)
    with pytest.raises(InputError, match=r"features in common|out of step"):
        range_map_from_pair(
            StereoPair(seen_towel.pair.left, other, "pair"),
            seen_towel.head,
            seen_towel.gaze,
            table=TABLE,
        )


def test_images_that_were_cropped_are_refused(seen_towel: Any) -> None:
    left, right = seen_towel.pair.left[:, :-100], seen_towel.pair.right[:, :-100]
    with pytest.raises(InputError, match="neither crop nor enlarge"):
        range_map_from_pair(
            StereoPair(left, right, "pair"), seen_towel.head, seen_towel.gaze, table=TABLE
        )
