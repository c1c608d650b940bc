"""Heights on the grid: exact planes, disparity offsets and height bands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.models.transforms import inverse
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.heights import heights_on_grid
from unwrinkle.perception.stereo.matching import Disparity
from unwrinkle.perception.stereo.rectification import rectify

HEAD = nominal_head()
GAZE = HEAD.gaze_at(np.array([0.0, -1.2, 0.7]))
X_WL, X_WR = HEAD.poses(GAZE)
RECTIFICATION = rectify(
    HEAD.left.camera.scaled(0.125), HEAD.right.camera.scaled(0.125), inverse(X_WL) @ X_WR
)
X_WC = X_WL @ RECTIFICATION.X_LC
GRID = Grid(-0.2, -1.35, 101, 81, 0.004)


def level_disparity(z: float) -> Disparity:
    """Disparity of a level plane at world height z."""
    x, y = RECTIFICATION.camera.rays()
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ X_WC[:3, :3].T
    depth = (z - X_WC[2, 3]) / rays[..., 2]
    values = RECTIFICATION.disparity(np.where(depth > 0.0, depth, 10.0)).astype(np.float32)
    return Disparity(values, depth > 0.0)


def heights(disparity: Disparity, **options: object) -> tuple[np.ndarray, np.ndarray]:
    plane = X_WC[2, :3], float(X_WC[2, 3]) - 0.70
    return heights_on_grid(disparity, RECTIFICATION, X_WC, plane, GRID, **options)  # type: ignore[arg-type]


@settings(max_examples=10, deadline=None)
@given(z=st.floats(0.66, 0.9))
def test_a_level_plane_is_level_and_as_high_as_it_is(z: float) -> None:
    height, enough = heights(level_disparity(z))
    assert enough.all()
    np.testing.assert_allclose(height, z - 0.70, atol=2e-5)


def test_an_offset_raises_by_its_depth() -> None:
    plain, _ = heights(level_disparity(0.70))
    raised, _ = heights(level_disparity(0.70), offset=0.1)
    # 1/8 of the resolution: 8 x 2 mm of height a pixel or so.
    per_pixel = float(np.median(raised - plain)) / 0.1
    assert 0.012 < per_pixel < 0.022


def test_what_is_outside_the_band_or_not_valid_is_left_out() -> None:
    disparity = level_disparity(0.80)
    assert not heights(disparity, band=(-0.03, 0.05))[1].any()
    nothing = Disparity(disparity.disparity, np.zeros_like(disparity.valid))
    height, enough = heights(nothing)
    assert not enough.any()
    assert not height.any()


def test_holes_stay_holes() -> None:
    disparity = level_disparity(0.70)
    valid = disparity.valid.copy()
    middle = valid.shape[0] // 2, valid.shape[1] // 2
    valid[middle[0] - 12 : middle[0] + 12, middle[1] - 12 : middle[1] + 12] = False
    _, enough = heights(Disparity(disparity.disparity, valid))
    share = np.count_nonzero(~enough) / enough.size
    assert share == pytest.approx((24 * 2.3 / 912) ** 2 * 1.4 / (0.4 * 0.32), rel=0.5)
