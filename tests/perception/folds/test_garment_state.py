"""State, borders and flaps of garments of known geometry."""

import dataclasses as dc
import math

import numpy as np
import pytest

from unwrinkle.models.garment import KnownGarment, rectangle
from unwrinkle.perception.folds.garment_state import FoldAnalysis, GarmentState, analyse_folds
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.testing.folded_garments import folded_map

TOWEL = rectangle("towel", 0.48, 0.48, 0.0025)
DISHCLOTH = rectangle("dishcloth", 0.38, 0.54, 0.0025)
#: A shirt's body with two short sleeves.
SHIRT = KnownGarment(
    "shirt",
    0.36 * 0.50 + 2 * 0.12 * 0.14,
    0.0025,
    [
        [-0.18, -0.25],
        [0.18, -0.25],
        [0.18, 0.11],
        [0.30, 0.11],
        [0.30, 0.25],
        [-0.30, 0.25],
        [-0.30, 0.11],
        [-0.18, 0.11],
    ],
)
CORNER, EDGE, SLEEVE = (0.75, 0.22), (0.03, 0.14), (0.0, 0.22)
FOLDS = [
    (TOWEL, CORNER, 0.004),
    (TOWEL, CORNER, 0.0),
    (TOWEL, EDGE, 0.006),
    (DISHCLOTH, CORNER, 0.004),
    (DISHCLOTH, (math.pi / 2, 0.16), 0.004),
    (SHIRT, SLEEVE, 0.004),
    (SHIRT, (-math.pi / 2, 0.15), 0.004),
]


def found(range_map: RangeMap, known: KnownGarment | None = None) -> FoldAnalysis:
    return analyse_folds(range_map, (), noise_profile(range_map.sensor), known)


def folded_over(known: KnownGarment, line: tuple[float, float]) -> float:
    """The area of the part of a garment beyond a line, m^2."""
    step = 0.001
    u, v = np.meshgrid(np.arange(-0.4, 0.4, step), np.arange(-0.4, 0.4, step))
    beyond = u * math.cos(line[0]) + v * math.sin(line[0]) > line[1]
    whole = folded_map(known.corners, sensor="stereo")
    ny, nx = whole.shape
    columns = np.rint(u / whole.resolution).astype(int) + nx // 2
    rows = np.rint(v / whole.resolution).astype(int) + ny // 2
    ok = (columns >= 0) & (columns < nx) & (rows >= 0) & (rows < ny)
    inside = np.zeros(u.shape, dtype=bool)
    inside[ok] = whole.garment[rows[ok], columns[ok]]
    return float((inside & beyond).sum()) * step**2


@pytest.mark.parametrize("sensor", ["stereo", "stereo-head", "xtion"])
@pytest.mark.parametrize("known", [TOWEL, DISHCLOTH, SHIRT], ids=lambda k: k.name)
def test_flat_is_flat(known: KnownGarment, sensor: str) -> None:
    range_map = folded_map(known.corners, yaw=0.3, sensor=sensor)
    for analysis in (found(range_map, known), found(range_map)):
        assert analysis.state is GarmentState.FLAT, analysis.reasons
        assert not analysis.flaps and not analysis.borders


@pytest.mark.parametrize(("known", "line", "bulge"), FOLDS)
@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_a_flap_is_found_with_its_line_and_direction(
    known: KnownGarment, line: tuple[float, float], bulge: float, yaw: float
) -> None:
    analysis = found(folded_map(known.corners, line, yaw=yaw, bulge=bulge), known)
    assert analysis.state is GarmentState.FOLDED
    area = folded_over(known, line)
    assert analysis.hidden == pytest.approx(area / known.flat_area, abs=0.015)
    (flap,) = analysis.flaps
    assert flap.area == pytest.approx(area, rel=0.15)
    opening = np.array([math.cos(line[0] + yaw), math.sin(line[0] + yaw)])
    assert flap.opening @ opening > math.cos(math.radians(2.0))
    ends = flap.line - np.array([0.0, -1.10])
    assert ends @ opening == pytest.approx([line[1]] * 2, abs=0.004)
    # It is held at the far side, on the garment.
    assert (flap.hold - np.array([0.0, -1.10])) @ opening < line[1] - 0.02


@pytest.mark.parametrize(("known", "line", "bulge"), FOLDS)
def test_without_the_flat_area_borders_tell_the_fold(
    known: KnownGarment, line: tuple[float, float], bulge: float
) -> None:
    analysis = found(folded_map(known.corners, line, yaw=0.2, bulge=bulge))
    assert analysis.state is GarmentState.FOLDED
    assert analysis.hidden is None
    opening = np.array([math.cos(line[0] + 0.2), math.sin(line[0] + 0.2)])
    largest = analysis.flaps[0]
    assert largest.by == "borders"
    assert largest.area == pytest.approx(folded_over(known, line), rel=0.25)
    assert largest.opening @ opening > math.cos(math.radians(5.0))


@pytest.mark.parametrize("known", [TOWEL, SHIRT], ids=lambda k: k.name)
def test_a_coarse_sensor_finds_a_loose_flap_of_a_known_garment(known: KnownGarment) -> None:
    line = CORNER if known is TOWEL else SLEEVE
    range_map = folded_map(known.corners, line, yaw=0.2, bulge=0.012, sensor="xtion")
    analysis = found(range_map, known)
    assert analysis.state is GarmentState.FOLDED
    (flap,) = analysis.flaps
    assert flap.area == pytest.approx(folded_over(known, line), rel=0.2)
    assert found(range_map).state in (GarmentState.FOLDED, GarmentState.NOT_FLAT)


def with_ridge(range_map: RangeMap, height: float, sigma: float = 0.012) -> RangeMap:
    """Add a straight ridge along x through the garment's centre."""
    y = range_map.origin[1] + range_map.resolution * np.arange(range_map.shape[0]) + 1.10
    raised = range_map.height + height * np.exp(-0.5 * (y / sigma) ** 2)[:, None]
    return dc.replace(range_map, height=np.where(range_map.garment, raised, range_map.height))


def test_a_ridge_is_a_wrinkle_and_no_fold() -> None:
    # The cloth of the ridge is taken from the garment's length: its surface keeps its area.
    slack = 0.015**2 * math.sqrt(math.pi) / (4.0 * 0.012)
    corners = np.array(TOWEL.outline) * np.array([1.0, (0.48 - slack) / 0.48])
    range_map = with_ridge(folded_map(corners), 0.015)
    known = found(range_map, TOWEL)
    assert known.state is GarmentState.WRINKLED, known.reasons
    assert known.hidden == pytest.approx(0.0, abs=0.01)
    assert found(range_map).state is GarmentState.WRINKLED


def test_a_crumpled_map_of_a_coarse_sensor_is_not_flat_without_the_area() -> None:
    range_map = with_ridge(folded_map(TOWEL.outline, sensor="xtion"), 0.02, 0.02)
    assert found(range_map).state is GarmentState.NOT_FLAT


def test_a_mask_by_depth_alone_is_never_flat_for_a_coarse_sensor() -> None:
    flat = folded_map(TOWEL.outline, sensor="xtion")
    by_depth = dc.replace(flat, mask_by="depth")
    assert found(flat).state is GarmentState.FLAT
    assert found(by_depth).state is GarmentState.UNSEEN
    assert "depth alone" in found(by_depth).reasons[0]
    assert found(by_depth, TOWEL).state is GarmentState.FLAT  # all of its area was found
    fine = dc.replace(folded_map(TOWEL.outline), mask_by="depth")
    assert found(fine).state is GarmentState.FLAT


def test_what_is_not_the_garment_is_not_seen_well_enough() -> None:
    towel = folded_map(TOWEL.outline)
    larger, smaller = rectangle("tea towel", 0.3, 0.3), rectangle("blanket", 1.4, 1.4)
    assert found(towel, larger).state is GarmentState.UNSEEN
    assert found(towel, smaller).state is GarmentState.UNSEEN
    # A part of the garment that is missing is no flat garment.
    rows = np.arange(towel.shape[0])[:, None] < 0.45 * towel.shape[0]
    half = dc.replace(towel, garment=towel.garment & rows)
    assert found(half, TOWEL).state is GarmentState.FOLDED


def test_holes_are_not_flat() -> None:
    towel = folded_map(TOWEL.outline)
    rng = np.random.default_rng(3)
    for share, state in ((0.03, GarmentState.FLAT), (0.3, GarmentState.UNSEEN)):
        columns = rng.permutation(towel.shape[1] // 8)[: round(share * towel.shape[1] / 8)]
        valid = ~np.isin(np.arange(towel.shape[1]) // 8, columns)
        holed = dc.replace(towel, valid=towel.valid & valid[None, :])
        assert found(holed, TOWEL).state is state
    unseen = dc.replace(
        towel, valid=towel.valid & (np.arange(towel.shape[1]) < 0.45 * towel.shape[1])[None, :]
    )
    assert found(unseen).state is GarmentState.UNSEEN


def test_json_is_plain() -> None:
    plain = found(folded_map(TOWEL.outline, CORNER, bulge=0.004), TOWEL).to_json()
    assert plain["state"] == "folded or crumpled" and len(plain["flaps"]) == 1
    assert all(math.isfinite(v) for v in plain["flaps"][0]["hold"])
