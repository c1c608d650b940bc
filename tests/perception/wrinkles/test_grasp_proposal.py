"""Grasps across ridges of known place, direction and width."""

from functools import cache

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.grasp_proposal import (
    CREST_REACH,
    GraspProposal,
    NoGrasp,
    across_direction,
    grasp_at,
    propose_grasp,
)
from unwrinkle.perception.wrinkles.surface import Surface, fit_surface
from unwrinkle.perception.wrinkles.wrinkledness import wrinkledness

TABLE = 0.70
PROFILE = noise_profile("stereo-head")
CENTRE = np.array([0.02, -1.10])
SIGMA, HEIGHT = 0.010, 0.020


@cache
def _surface(angle: float, height: float = HEIGHT) -> Surface:
    """Return a sheet with one Gaussian ridge through CENTRE; `angle` is the direction across it."""
    half, step = 0.07, PROFILE.resolution
    ticks = np.arange(-half - 0.02, half + 0.02, step)
    x, y = np.meshgrid(ticks, ticks)
    on = (np.abs(x) < half) & (np.abs(y) < half)
    across = x * np.cos(angle) + y * np.sin(angle)
    along = y * np.cos(angle) - x * np.sin(angle)
    ridge = height * np.exp(-0.5 * (across / SIGMA) ** 2 - 0.5 * (along / 0.035) ** 4)
    z = np.where(on, 0.002 + ridge, 0.0).astype(np.float32)
    valid = np.ones(z.shape, dtype=bool)
    range_map = RangeMap(z, valid, on, step, CENTRE + ticks[0], TABLE, "stereo-head")
    return fit_surface(range_map, PROFILE)


@pytest.mark.parametrize("angle", [0.4, -1.2])
def test_a_ridge_is_grasped_across_at_its_crest(angle: float) -> None:
    surface = _surface(angle)
    across = np.array([np.cos(angle), np.sin(angle)])
    beside = CENTRE + 0.006 * across + 0.01 * np.array([-across[1], across[0]])
    grasp = grasp_at(surface, beside, PROFILE, TABLE)
    assert isinstance(grasp, GraspProposal)
    assert abs(float(grasp.across @ across)) > np.cos(np.radians(4.0))
    assert abs(float((grasp.p_WG[:2] - CENTRE) @ across)) < 0.0015  # on the crest
    assert grasp.width == pytest.approx(2.0 * SIGMA, rel=0.15)  # inflections at a sigma
    assert grasp.height == pytest.approx(0.002 + HEIGHT, abs=0.0015)
    assert grasp.p_WG[2] == pytest.approx(TABLE + grasp.height)
    assert grasp.rise == pytest.approx(HEIGHT * (1.0 - np.exp(-0.5)), rel=0.2)
    sides = (grasp.contours[:, :2] - grasp.p_WG[:2]) @ grasp.across
    assert sides[0] < 0.0 < sides[1]


def test_the_most_wrinkled_point_of_one_ridge_lies_on_it() -> None:
    surface = _surface(0.4)
    grasp = propose_grasp(surface, wrinkledness(surface, PROFILE), PROFILE, TABLE)
    assert isinstance(grasp, GraspProposal)
    across = np.array([np.cos(0.4), np.sin(0.4)])
    assert abs(float((grasp.p_WG[:2] - CENTRE) @ across)) < 0.004
    assert grasp.score > 0.0
    assert set(grasp.to_json()) >= {"p_WG", "across", "width", "height"}


def test_flat_cloth_gives_a_reason() -> None:
    surface = _surface(0.0, height=0.0)
    assert isinstance(
        propose_grasp(surface, wrinkledness(surface, PROFILE), PROFILE, TABLE), NoGrasp
    )
    grasp = grasp_at(surface, CENTRE, PROFILE, TABLE)
    assert isinstance(grasp, NoGrasp) and "0.020" in grasp.reason


def test_a_point_beside_the_garment_gives_a_reason() -> None:
    grasp = grasp_at(_surface(0.4), CENTRE + 0.5, PROFILE, TABLE)
    assert isinstance(grasp, NoGrasp) and "not on the garment" in grasp.reason


def test_a_point_far_down_the_slope_is_not_moved_to_the_crest() -> None:
    surface = _surface(0.4)
    across = np.array([np.cos(0.4), np.sin(0.4)])
    assert abs(float(across_direction(surface, CENTRE) @ across)) > 0.99
    grasp = grasp_at(surface, CENTRE + (CREST_REACH + 0.006) * across, PROFILE, TABLE)
    assert isinstance(grasp, NoGrasp)


def test_a_proposal_refuses_what_is_no_direction() -> None:
    with pytest.raises(InputError, match="length 1"):
        GraspProposal(np.zeros(3), np.array([1.0, 1.0]), np.zeros((2, 3)), 0.01, 0.02)
    with pytest.raises(InputError, match="finite"):
        GraspProposal(np.full(3, np.nan), np.array([1.0, 0.0]), np.zeros((2, 3)), 0.01, 0.02)
