import dataclasses as dc
import math

import numpy as np
import pytest

from unwrinkle.models.choices import PullReading
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.target import (
    STRETCH_LIMIT,
    STRETCH_MARGIN,
    FlatteningTarget,
    NoTarget,
)
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.perception.wrinkles.targeting import (
    GRASP_INSET,
    flattening_target,
    garment_contour,
    section_length,
    section_place,
    section_start,
)
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import TABLE
from unwrinkle.testing.towels import flat_map, map_of

CENTRE = (0.0, -1.1)


def analysed(angle=0.0, *, height=0.022, centre=CENTRE, side=0.4, extent=0.5, **options):
    towel = Towel(
        ridges=(Ridge(centre, angle, height, 0.0135, 0.2),), centre=centre, side=side, waviness=0.0
    )
    return analyse(map_of(towel, 0.0005, extent=extent), **options, table=TABLE)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3, -0.9])
def test_the_hands_stand_across_the_wrinkle_on_the_contour(angle):
    analysis = analysed(angle)
    target = analysis.target_for(0)
    assert isinstance(target, FlatteningTarget)
    normal = analysis.wrinkles[0].normal
    contour = garment_contour(analysis.surface)
    for sign, hand in zip((-1.0, 1.0), target.hands, strict=True):
        away = hand.p_WG[:2] - target.p_WC[:2]
        assert away @ (sign * normal) == pytest.approx(np.hypot(*away), abs=1e-6)
        assert hand.pull_direction @ (sign * normal) == pytest.approx(1.0, abs=1e-6)
        assert hand.grasp_direction @ hand.pull_direction < -0.6
        assert hand.p_WG[2] == pytest.approx(0.7)
        assert np.abs(hand.p_WG[:2] - np.array(CENTRE)).max() == pytest.approx(0.195, abs=0.004)
        assert contour.contains(hand.p_WG[:2])
        assert not contour.contains(hand.p_WG[:2] + 1.5 * GRASP_INSET * hand.pull_direction)


def test_geodesic_distance_is_the_sections_length():
    target = analysed().target_for(0)
    apart = abs(target.hands[1].p_WG[1] - target.hands[0].p_WG[1])
    x = np.linspace(-0.2, 0.2, 40001)
    z = 0.022 * np.exp(-0.5 * (x / 0.0135) ** 2)
    extra = np.sum(np.hypot(np.diff(x), np.diff(z))) - 0.4
    assert target.geodesic_distance == pytest.approx(apart + extra, abs=0.0005)


def test_each_hand_pulls_the_modes_distance():
    for mode in PullReading:
        analysis = analysed(mode=mode)
        assert analysis.target_for(0).mode == mode
        for hand in analysis.target_for(0).hands:
            assert hand.pull_distance == analysis.wrinkles[0].pull_distance(mode)


def test_pull_is_limited_by_the_cloth_between_the_hands():
    """A narrow garment: 1.1 x slack for each hand would overstretch it."""
    analysis = analysed(height=0.03, side=0.14, extent=0.3)
    target = analysis.target_for(0)
    assert isinstance(target, FlatteningTarget)
    pulls = [hand.pull_distance for hand in target.hands]
    assert pulls[0] == pulls[1] < analysis.wrinkles[0].pull_distance("foot")
    longest = STRETCH_LIMIT * target.geodesic_distance - STRETCH_MARGIN
    assert target.final_grip_distance == pytest.approx(longest, abs=1e-9)
    section = dc.replace(analysis, pull="section").target_for(0)
    assert section.final_grip_distance == pytest.approx(longest, abs=1e-9)


def test_section_length_on_flat_cloth_is_the_distance():
    analysis = analysed(height=0.022)
    start, end = np.array([-0.15, -1.25]), np.array([0.15, -1.22])
    length = section_length(analysis.surface, start, end)
    assert length == pytest.approx(np.hypot(*(end - start)), rel=2e-3)


@pytest.mark.parametrize("sensor", ["xtion", "tof"])
def test_a_ragged_outline_gives_steady_grasp_directions(sensor):
    flat = flat_map(sensor, 1)
    rng = np.random.default_rng(0)
    rows, columns = np.indices(flat.shape)
    ragged = flat.garment.copy()
    for axis in (0, 1):  # cells missing or too many along the rim, as depth edges are
        rim = ragged ^ np.roll(ragged, 1, axis)
        ragged ^= rim & (rng.random(flat.shape) < 0.5)
    noisy = RangeMap(flat.height, flat.valid, ragged, flat.resolution, flat.origin, 0.7, sensor)
    profile = analyse(noisy, table=TABLE).surface
    contour = garment_contour(profile)
    sides = 0
    for inward in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        along = np.array([-inward[1], inward[0]])
        for shift in np.linspace(-0.15, 0.15, 31):
            _, normal = contour.leave(np.array(CENTRE) + shift * along, -np.array(inward))
            assert math.degrees(math.acos(min(normal @ np.array(inward), 1.0))) < 12.0
            sides += 1
    assert sides == 124
    assert rows.shape == columns.shape


def test_over_the_tables_edge_there_is_a_reason():
    target = analysed(1.3, centre=(0.25, -1.1)).target_for(0)
    assert isinstance(target, NoTarget)
    assert "table's edge" in target.reason and not target.flat


def test_a_contour_cut_by_the_image_is_a_reason():
    target = analysed(side=0.5, extent=0.42).target_for(0)
    assert isinstance(target, NoTarget)
    assert "border" in target.reason


def test_a_section_is_shifted_where_the_one_through_the_centre_fails():
    """A table that ends between the wrinkle's centre and one of its ends."""
    free = analysed(math.pi / 2).target_for(0)
    edge = Table((0.0, -1.1), (0.8, 0.8), 0.70)
    assert isinstance(free, FlatteningTarget)
    analysis = analysed(math.radians(70.0))
    whole = flattening_target(
        analysis.range_map, analysis.surface, analysis.wrinkles[0], table=edge
    )
    tops = [hand.p_WG[1] for hand in whole.hands]
    cut = Table((0.0, max(tops) - 0.02 - 0.4), (0.8, 0.8), 0.70)
    shifted = flattening_target(
        analysis.range_map, analysis.surface, analysis.wrinkles[0], table=cut
    )
    assert isinstance(shifted, FlatteningTarget)
    assert max(hand.p_WG[1] for hand in shifted.hands) < max(tops) - 0.019


def test_an_unknown_mode_is_refused_and_a_centre_off_the_garment_is_a_reason():
    analysis = analysed()
    for wrong in ({"mode": "feet"}, {"section": "end"}, {"pull": "all"}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            flattening_target(
                analysis.range_map, analysis.surface, analysis.wrinkles[0], **wrong, table=TABLE
            )
    assert garment_contour(analysis.surface, np.array([0.24, -1.1])) is None


def rising(shares, heights):
    """A wrinkle that is as high as `heights` say at `shares` of its length, analysed both ways."""
    towel = Towel(ridges=(Ridge(CENTRE, 0.0, 0.020, 0.0135, 0.2),), side=0.4, waviness=0.0)
    seen = map_of(towel, 0.001, extent=0.5)
    bare = map_of(dc.replace(towel, ridges=()), 0.001, extent=0.5)
    x = seen.origin[0] + seen.resolution * np.arange(seen.shape[1])
    factor = np.interp(x, -0.12 + 0.24 * np.array(shares), heights)
    height = bare.height + (factor * (seen.height - bare.height)).astype(np.float32)
    return dc.replace(seen, height=height)


def test_the_section_goes_through_the_highest_part_where_asked():
    seen = rising([0.0, 0.3, 0.45, 1.0], [0.6, 1.0, 0.6, 0.6])
    highest = analyse(seen, section="highest", table=TABLE)
    centre = dc.replace(highest, section="centre").target_for(0)
    (wrinkle,) = highest.wrinkles
    place = section_place(wrinkle, "highest")
    assert section_start(wrinkle, place)[0] == pytest.approx(-0.048, abs=0.012)
    assert highest.target_for(0).p_WC[0] == pytest.approx(section_start(wrinkle, place)[0])
    assert centre.p_WC[0] == wrinkle.centre[0] > highest.target_for(0).p_WC[0] + 0.02
    assert highest.target_for(0).to_json() == highest.target_for(0).to_json()


def test_the_highest_part_at_an_end_keeps_away_from_it():
    (wrinkle,) = analyse(rising([0.0, 1.0], [0.4, 1.0]), table=TABLE).wrinkles
    place = section_place(wrinkle, "highest")
    assert 0.3 < abs(place - 0.5) <= 0.4 and section_start(wrinkle, place)[0] > 0.05


def test_all_slack_that_the_section_crosses_is_pulled_where_asked():
    """Two parallel wrinkles: the section across one crosses the other too."""
    ridges = tuple(Ridge((0.0, y), 0.0, 0.018, 0.011, 0.24) for y in (-1.17, -1.03))
    seen = map_of(Towel(ridges=ridges, side=0.4, waviness=0.0), 0.001, extent=0.5)
    both = analyse(seen, pull="section", table=TABLE)
    one = dc.replace(both, pull="wrinkle").target_for(0)
    pulls = [found.hands[0].pull_distance for found in (one, both.target_for(0))]
    assert pulls[0] == both.wrinkles[0].pull_distance("foot")
    apart = np.hypot(*(both.target_for(0).hands[1].p_WG - both.target_for(0).hands[0].p_WG)[:2])
    assert pulls[1] == pytest.approx(1.10 * (both.target_for(0).geodesic_distance - apart))
    assert 1.7 * pulls[0] < pulls[1] < 2.6 * pulls[0]
    assert (
        both.target_for(0).final_grip_distance
        <= STRETCH_LIMIT * both.target_for(0).geodesic_distance + 1e-9
    )
