"""The garment's mesh for the preview."""

import numpy as np
import pytest

from unwrinkle.flattening.garment_surface import MOST_VERTICES, garment_surface
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap

RESOLUTION = 0.002
ORIGIN = np.array([-0.3, -1.4])


def _range_map(colour: bool = False, hole: bool = False) -> RangeMap:
    """300 x 280 cells with a garment of 240 x 200, as high as 0.01 m + a tenth of its x."""
    height = np.zeros((280, 300), dtype=np.float32)
    garment = np.zeros(height.shape, dtype=bool)
    garment[40:240, 30:270] = True
    x = ORIGIN[0] + RESOLUTION * np.arange(300)
    height[:] = np.where(garment, 0.05 + 0.1 * x, 0.0)
    valid = np.ones(height.shape, dtype=bool)
    if hole:
        valid[100:130, 100:150] = False
    rgb = np.zeros((*height.shape, 3), dtype=np.uint8)
    rgb[..., 0], rgb[..., 2] = 200, 30
    rgb[:, 150:, 1] = 90
    return RangeMap(
        height, valid, garment, RESOLUTION, ORIGIN, 0.7, "stereo", rgb if colour else None
    )


def test_mesh_lies_on_the_cloth_and_is_small() -> None:
    surface = garment_surface(_range_map())
    assert 5000 < len(surface.p_WV) <= MOST_VERTICES**2
    x, y, z = surface.p_WV.T
    np.testing.assert_allclose(z, 0.75 + 0.1 * x, atol=1e-6)
    assert x.min() == pytest.approx(ORIGIN[0] + 30 * RESOLUTION, abs=0.004)
    assert x.max() == pytest.approx(ORIGIN[0] + 269 * RESOLUTION, abs=0.004)
    assert y.min() == pytest.approx(ORIGIN[1] + 40 * RESOLUTION, abs=0.004)
    assert y.max() == pytest.approx(ORIGIN[1] + 239 * RESOLUTION, abs=0.004)


def test_every_triangle_faces_up_and_all_cover_the_garment() -> None:
    surface = garment_surface(_range_map())
    a, b, c = (surface.p_WV[surface.triangles[:, k]].astype(float) for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(0.48 * 0.40, rel=0.03)
    assert set(np.unique(surface.triangles)) == set(range(len(surface.p_WV)))


def test_colours_are_the_camera_s_or_the_height_s() -> None:
    surface = garment_surface(_range_map(colour=True))
    right = surface.p_WV[:, 0] > ORIGIN[0] + 152 * RESOLUTION
    left = surface.p_WV[:, 0] < ORIGIN[0] + 148 * RESOLUTION
    assert np.all(surface.colours[right] == [200, 90, 30])
    assert np.all(surface.colours[left] == [200, 0, 30])
    plain = garment_surface(_range_map())
    low, high = plain.p_WV[:, 2].argmin(), plain.p_WV[:, 2].argmax()
    assert plain.colours[high].sum() > plain.colours[low].sum() + 200


def test_what_was_not_measured_is_a_hole() -> None:
    whole, holed = garment_surface(_range_map()), garment_surface(_range_map(hole=True))
    assert len(holed.p_WV) < len(whole.p_WV)
    x, y, z = holed.p_WV.T
    inside = (x > ORIGIN[0] + 0.21) & (x < ORIGIN[0] + 0.29)
    inside &= (y > ORIGIN[1] + 0.21) & (y < ORIGIN[1] + 0.25)
    assert not np.any(inside)
    np.testing.assert_allclose(z, 0.75 + 0.1 * x, atol=3e-4)


def test_ridge_and_outline_lie_above_their_places() -> None:
    ridge = np.array([[0.0, -1.2, 0.76], [0.0, -1.1, 0.77]])
    corners = np.array([[-0.1, -1.2], [0.1, -1.2], [0.0, -1.0]])
    surface = garment_surface(_range_map(), ridge, corners)
    np.testing.assert_allclose(surface.ridge, ridge + [0.0, 0.0, 0.001], atol=1e-6)
    np.testing.assert_allclose(surface.outline[:3, :2], corners, atol=1e-6)
    np.testing.assert_array_equal(surface.outline[0], surface.outline[-1])
    found = garment_surface(_range_map())
    assert len(found.ridge) == 0
    assert np.ptp(found.outline[:, 0]) == pytest.approx(239 * RESOLUTION, abs=0.005)


def test_no_garment_is_refused() -> None:
    full = _range_map()
    nothing = RangeMap(
        full.height, full.valid, np.zeros_like(full.garment), RESOLUTION, ORIGIN, 0.7, "stereo"
    )
    with pytest.raises(InputError, match="no measured cell"):
        garment_surface(nothing)
    unseen = RangeMap(
        full.height, np.zeros_like(full.valid), full.garment, RESOLUTION, ORIGIN, 0.7, "stereo"
    )
    with pytest.raises(InputError, match="no measured cell"):
        garment_surface(unseen)
    speck = np.zeros_like(full.garment)
    speck[10, 10] = True
    with pytest.raises(InputError, match="too small"):
        garment_surface(RangeMap(full.height, full.valid, speck, RESOLUTION, ORIGIN, 0.7, "stereo"))
