import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.perception.wrinkles.wrinkle import PULL_COEFFICIENT, triplet_height, volume_score
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import TABLE
from unwrinkle.testing.towels import flat_map, map_of

CENTRE = (0.0, -1.1)


def wrinkles_of(*ridges, side=0.4, **changes):
    towel = Towel(ridges=ridges, side=side, **changes)
    return analyse(map_of(towel, 0.0005, extent=side + 0.05), table=TABLE).wrinkles


def slack(height, sigma, reach):
    """Arc length of a Gaussian section minus its chord, between -reach and reach."""
    x = np.linspace(-reach, reach, 20001)
    z = height * np.exp(-0.5 * (x / sigma) ** 2)
    return float(np.sum(np.hypot(np.diff(x), np.diff(z)))) - 2.0 * reach


def heights(a, b, c):
    return triplet_height(np.array([a]), np.array([b]), np.array([c]))[0]


def test_height_of_the_3_4_5_triangle():
    assert heights(3.0, 4.0, 5.0) == pytest.approx(2.4)


def test_height_of_degenerate_triangles_is_zero():
    assert heights(1.0, 2.0, 3.0) == 0.0
    assert heights(1.0, 1.0, 2.0 + 1e-12) == 0.0
    assert heights(1.0, 1.0, 0.0) == 0.0


@given(st.floats(0.1, 10.0), st.floats(0.05, 0.95), st.floats(0.01, 5.0))
def test_height_is_that_of_the_apex(base, share, height):
    a = math.hypot(share * base, height)
    b = math.hypot((1.0 - share) * base, height)
    assert heights(a, b, base) == pytest.approx(height, rel=1e-6)


def test_volume_score_is_in_millimetres():
    score = volume_score(0.1, np.array([0.02, 0.03]), np.array([0.005, 0.006]))
    assert score == pytest.approx(math.log(100.0) + math.log(0.5 * (100.0 + 180.0)))


@pytest.mark.parametrize(
    ("height", "sigma"), [(0.022, 0.0135), (0.014, 0.010), (0.006, 0.0075), (0.010, 0.015)]
)
@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2])
def test_measures_of_a_gaussian_ridge(height, sigma, angle):
    (wrinkle,) = wrinkles_of(Ridge(CENTRE, angle, height, sigma, 0.2))
    assert wrinkle.width == pytest.approx(2.0 * sigma, abs=0.0003)
    assert wrinkle.chord_height == pytest.approx((1 - math.exp(-0.5)) * height, abs=0.0003)
    assert wrinkle.peak_height == pytest.approx(height, abs=0.0006)
    off = math.atan2(wrinkle.direction[1], wrinkle.direction[0]) - angle
    assert abs((off + np.pi / 2) % np.pi - np.pi / 2) < math.radians(1.0)
    assert np.hypot(*(wrinkle.centre - np.array(CENTRE))) < 0.01
    assert 0.16 < wrinkle.length < 0.2 + 4.0 * sigma
    assert wrinkle.triplets >= 0.9 * wrinkle.samples
    assert np.hypot(*wrinkle.normal) == pytest.approx(1.0)


def test_pull_distances_are_equation_5_in_both_readings():
    height, sigma = 0.022, 0.0135
    towel = Towel(ridges=(Ridge(CENTRE, 0.4, height, sigma, 0.34),), side=0.46)
    (wrinkle,) = analyse(map_of(towel, 0.0005), table=TABLE).wrinkles
    # The faded ends are in the mean, hence a little less than the formula.
    paper = PULL_COEFFICIENT * slack(height, sigma, sigma)
    foot = PULL_COEFFICIENT * slack(height, sigma, 6.0 * sigma)
    assert 0.90 * paper < wrinkle.pull_distance_paper < 1.02 * paper
    assert 0.90 * foot < wrinkle.pull_distance_foot < 1.02 * foot
    assert wrinkle.pull_distance_paper / wrinkle.pull_distance_foot == pytest.approx(0.43, abs=0.02)
    assert wrinkle.pull_distance("paper") == wrinkle.pull_distance_paper
    assert wrinkle.pull_distance("between") == pytest.approx(0.5 * (paper + foot), rel=0.1)
    assert (
        wrinkle.pull_distance_paper < wrinkle.pull_distance("between") < wrinkle.pull_distance_foot
    )
    with pytest.raises(InputError, match="mode"):
        wrinkle.pull_distance("feet")


def test_contours_lie_on_their_sides():
    for angle in (0.3, 1.2, 2.2, 3.0):
        (wrinkle,) = wrinkles_of(Ridge(CENTRE, angle, 0.015, 0.011, 0.2))
        for sign, contour in zip((-1.0, 1.0), wrinkle.contours, strict=True):
            side = (contour[:, :2] - wrinkle.crests[:, :2]) @ wrinkle.normal
            assert np.all(sign * side > 0.005)
        assert wrinkle.direction[0] >= 0.0


def test_the_edge_of_a_layer_is_no_wrinkle():
    """A second layer of cloth on half of the garment: a step of 8 mm over 3 mm."""
    for sensor, resolution, layer in (("stereo", 0.0005, 0.008), ("xtion", 0.002, 0.015)):
        flat = flat_map(sensor, 0)
        x = (np.arange(flat.shape[1]) - 0.5 * flat.shape[1]) * resolution
        step = layer * np.clip((x + 0.0015) / 0.003, 0.0, 1.0)[None, :]
        height = (flat.height + step).astype(np.float32)
        raised = RangeMap(
            height, flat.valid, flat.garment, flat.resolution, flat.origin, 0.7, sensor
        )
        analysis = analyse(raised, table=TABLE)
        assert [w for w in analysis.wrinkles if abs(w.centre[0]) < 0.05] == []


def test_a_roll_at_the_rim_is_no_wrinkle():
    """A hem that rolls down to the table has cloth on one side only."""
    wrinkles = wrinkles_of(Ridge((0.0, -1.1 + 0.196), 0.0, 0.02, 0.012, 0.25), waviness=0.0)
    assert [w for w in wrinkles if w.centre[1] > -1.1 + 0.15] == []


def xtion_sees(towel, seed):
    """Simulate an Xtion's oblique view of a towel: correlated noise, steps of 3 mm."""
    flat = flat_map("xtion", seed)
    clean = map_of(towel, 0.002, sensor="xtion", noise=0.0, extent=0.6)
    bare = map_of(replace(towel, ridges=()), 0.002, sensor="xtion", noise=0.0, extent=0.6)
    height = np.rint((flat.height + clean.height - bare.height) / 0.003) * 0.003
    return RangeMap(
        height.astype(np.float32), clean.valid, clean.garment, 0.002, clean.origin, 0.7, "xtion"
    )


def test_noise_of_an_xtion_neither_widens_nor_flattens():
    towel = Towel(ridges=(Ridge(CENTRE, 0.5, 0.014, 0.016, 0.3),), side=0.46)
    wrinkle = analyse(xtion_sees(towel, 3), table=TABLE).wrinkles[0]
    assert wrinkle.width == pytest.approx(0.032, abs=0.006)
    assert wrinkle.chord_height == pytest.approx(0.0055, abs=0.001)
    assert wrinkle.pull_distance_foot == pytest.approx(0.0057, abs=0.0012)


@pytest.mark.parametrize("seed", range(3))
def test_an_xtion_is_not_blind_to_a_short_high_fold(seed):
    """Regression: a fold 25 mm high was missed, its ridge being 55 mm long of 80 mm required."""
    angle = 0.3 + 0.7 * seed
    fold = Ridge((0.05, -1.2), angle, 0.025, 0.012, 0.055)
    wrinkle, *others = analyse(
        xtion_sees(Towel(ridges=(fold,), side=0.46, seed=seed), seed), table=TABLE
    ).wrinkles
    assert others == []
    assert wrinkle.length < noise_profile("xtion").wrinkle_length
    assert 0.015 < wrinkle.peak_height < 0.030
    assert wrinkle.pull_distance_foot > 0.005
    assert np.hypot(*(wrinkle.centre - np.array(fold.centre))) < 0.012
    off = math.atan2(wrinkle.direction[1], wrinkle.direction[0]) - angle
    assert abs((off + np.pi / 2) % np.pi - np.pi / 2) < math.radians(20.0)


def test_an_xtion_takes_no_noise_for_short_folds():
    found = [analyse(flat_map("xtion", seed), table=TABLE).wrinkles for seed in range(12)]
    assert found == [()] * 12


def test_json_has_points_only_if_asked():
    (wrinkle,) = wrinkles_of(Ridge(CENTRE, 0.4, 0.015, 0.012, 0.2))
    assert "curve" not in wrinkle.to_json()
    full = wrinkle.to_json(points=True)
    assert len(full["curve"]) == len(wrinkle.curve)
    assert full["angle"] == pytest.approx(0.4, abs=0.02)
