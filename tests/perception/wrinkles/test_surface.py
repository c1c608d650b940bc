from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.surface import (
    CAP,
    CLASS_BOUNDS,
    CUP,
    DOME,
    FLAT,
    RIDGE,
    RUT,
    SADDLE,
    SADDLE_RIDGE,
    SADDLE_RUT,
    TROUGH,
    classify,
    crest_direction,
    curvedness,
    fit_surface,
    majority_filter,
    principal_curvatures,
    shape_index,
    spread,
)
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.towels import map_of

curvature = st.floats(-100.0, 100.0)


def patch(zxx, zxy, zyy, zx=0.0, zy=0.0):
    arrays = [np.array([[v]], np.float32) for v in (zx, zy, zxx, zxy, zyy)]
    return principal_curvatures(*arrays)


@pytest.mark.parametrize(
    ("zxx", "zyy", "index", "label"),
    [
        (9.0, 9.0, -1.0, CUP),
        (9.0, 3.0, -0.7048, TROUGH),
        (9.0, 0.0, -0.5, RUT),
        (9.0, -3.7, -0.2513, SADDLE_RUT),
        (9.0, -9.0, 0.0, SADDLE),
        (-9.0, 3.7, 0.2513, SADDLE_RIDGE),
        (0.0, -9.0, 0.5, RIDGE),
        (-9.0, -3.0, 0.7048, DOME),
        (-9.0, -9.0, 1.0, CAP),
    ],
)
def test_analytic_patches_have_their_class(zxx, zyy, index, label):
    k_max, k_min = patch(zxx, 0.0, zyy)
    found = shape_index(k_max, k_min)
    assert found[0, 0] == pytest.approx(index, abs=1e-3)
    assert classify(found, curvedness(k_max, k_min), 1.0)[0, 0] == label


@given(curvature, curvature, curvature, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_shape_index_is_in_range_and_turns_with_the_sign_of_height(zxx, zxy, zyy, zx, zy):
    k_max, k_min = patch(zxx, zxy, zyy, zx, zy)
    assert k_max[0, 0] >= k_min[0, 0]
    index = shape_index(k_max, k_min)[0, 0]
    assert -1.0 <= index <= 1.0
    if curvedness(k_max, k_min)[0, 0] > 1.0 and k_max[0, 0] - k_min[0, 0] > 1e-2:
        turned = shape_index(*patch(-zxx, -zxy, -zyy, -zx, -zy))[0, 0]
        assert turned == pytest.approx(-index, abs=2e-3)


def test_a_sphere_has_the_curvature_of_its_radius_also_on_its_side():
    radius, x = 0.05, 0.02
    z = np.sqrt(radius**2 - x**2)
    k_max, k_min = patch(-(radius**2) / z**3, 0.0, -1.0 / z, -x / z, 0.0)
    assert k_max[0, 0] == pytest.approx(-1.0 / radius, rel=1e-4)
    assert k_min[0, 0] == pytest.approx(-1.0 / radius, rel=1e-4)


def test_class_bounds_are_where_the_paper_left_them_open():
    for label, bound in enumerate(CLASS_BOUNDS, start=1):
        sides = np.array([bound - 1e-4, bound + 1e-4], np.float32)
        assert classify(sides, np.full(2, 9.0, np.float32), 1.0).tolist() == [label, label + 1]


def test_little_curvature_is_flat():
    assert classify(np.array([0.5], np.float32), np.array([1.9], np.float32), 2.0)[0] == FLAT


@pytest.mark.parametrize("radius", [1, 3])
def test_majority_filter_equals_counting(radius):
    rng = np.random.default_rng(radius)
    classes = rng.integers(0, 10, (24, 31)).astype(np.uint8)
    found = majority_filter(classes, radius)
    for row in range(radius, 24 - radius):
        for column in range(radius, 31 - radius):
            window = classes[row - radius : row + radius + 1, column - radius : column + radius + 1]
            assert found[row, column] == np.argmax(np.bincount(window.ravel(), minlength=10))


def test_majority_filter_refuses_absurd_windows():
    with pytest.raises(InputError):
        majority_filter(np.zeros((5, 5), np.uint8), -1)


@given(st.floats(0.0, np.pi), st.floats(1.0, 100.0), st.floats(-0.5, 1.0))
def test_crest_direction_is_the_eigenvector_of_the_most_negative_eigenvalue(angle, bend, other):
    c, s = np.cos(angle), np.sin(angle)
    across, along = np.array([c, s]), np.array([-s, c])
    hessian = -bend * np.outer(across, across) + other * bend * np.outer(along, along)
    entries = (hessian[0, 0], hessian[0, 1], hessian[1, 1])
    dx, dy = crest_direction(*[np.array([v], np.float32) for v in entries])
    assert abs(dx[0] * c + dy[0] * s) == pytest.approx(1.0, abs=1e-4)


def test_the_rim_and_the_table_are_not_part_of_the_surface():
    towel = Towel(ridges=(), side=0.2, thickness=0.02, waviness=0.0)
    surface = fit_surface(map_of(towel, 0.0005, extent=0.3), noise_profile("stereo"))
    assert abs(surface.z[surface.inside].max() - 0.02) < 0.003
    middle = surface.cells(np.array(towel.centre)).astype(int)
    near = surface.classes[middle[1] - 60 : middle[1] + 60, middle[0] - 60 : middle[0] + 60]
    assert not near.any()
    assert (
        not surface.inside[surface.classes != FLAT].size
        or surface.inside[surface.classes != FLAT].all()
    )


def test_a_finer_map_gives_the_same_surface_on_the_same_grid_size():
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.4, 0.015, 0.012, 0.12),), side=0.24)
    profile = noise_profile("stereo")
    coarse = fit_surface(map_of(towel, 0.001, extent=0.3), profile)
    fine = fit_surface(map_of(towel, 0.00025, extent=0.3), profile)
    assert fine.resolution == pytest.approx(coarse.resolution)
    centre = np.array(towel.centre)
    heights = []
    for surface in (coarse, fine):
        column, row = np.rint(surface.cells(centre)).astype(int)
        heights.append(surface.z[row, column])
    assert heights[0] == pytest.approx(heights[1], abs=1e-4)


def test_spread_puts_samples_where_they_belong():
    towel = Towel(ridges=(Ridge((0.01, -1.09), 0.4, 0.015, 0.012, 0.1),), side=0.2)
    range_map = map_of(towel, 0.00025, extent=0.3, noise=0.0)
    surface = fit_surface(range_map, noise_profile("stereo"))
    height = spread(surface.z, surface, range_map)
    assert height.shape == range_map.shape
    core = np.zeros(range_map.shape, bool)
    core[250:-250, 250:-250] = True
    assert np.abs(height - range_map.height)[core].max() < 0.0012


def test_holes_in_the_garment_are_filled():
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.4, 0.015, 0.012, 0.12),), side=0.24)
    whole = map_of(towel, 0.001, extent=0.3)
    valid = np.random.default_rng(0).random(whole.shape) > 0.3
    holed = RangeMap(
        whole.height, valid, whole.garment, whole.resolution, whole.origin, 0.7, "stereo"
    )
    profile = noise_profile("stereo")
    one, other = fit_surface(whole, profile), fit_surface(holed, profile)
    core = one.inside & other.inside
    core[:20] = core[-20:] = core[:, :20] = core[:, -20:] = False
    assert np.abs(one.z - other.z)[core].max() < 2e-4


def test_no_garment_is_an_input_error():
    bare = map_of(Towel(ridges=(), side=0.2), 0.001)
    empty = RangeMap(
        bare.height, bare.valid, np.zeros(bare.shape, bool), 0.001, bare.origin, 0.7, "stereo"
    )
    with pytest.raises(InputError, match="no garment"):
        fit_surface(empty, noise_profile("stereo"))
    blind = RangeMap(
        bare.height, np.zeros(bare.shape, bool), bare.garment, 0.001, bare.origin, 0.7, "stereo"
    )
    with pytest.raises(InputError, match="no measured cell"):
        fit_surface(blind, noise_profile("stereo"))


def test_patches_jump_at_their_seams_and_the_single_surface_does_not():
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.0, 0.015, 0.012, 0.15),), side=0.2)
    range_map = map_of(towel, 0.001, extent=0.3)
    profile = replace(noise_profile("stereo"), smoothing=0.0, fine_smoothing=0.0)
    jumps = []
    for patches in (False, True):
        surface = fit_surface(range_map, profile, patches=patches)
        core = surface.zyy[60:-60, 60:-60]
        jumps.append(float(np.abs(np.diff(core, axis=1)).max()))
    assert jumps[1] > 3.0 * jumps[0]
