"""The cubic of the verification against scipy's, and the legs of a plan."""

import dataclasses as dc

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.planning.plan import FlatteningPlan, Segment
from unwrinkle.planning.verification.motion import JOINTS, Leg, legs

from .built import leg, wild_leg

OPENING = 0.03


def spline(motion: Leg) -> CubicHermiteSpline:
    return CubicHermiteSpline(motion.times, motion.positions, motion.velocities)


@pytest.mark.parametrize("seed", range(3))
def test_the_cubic_is_that_of_scipy(seed: int) -> None:
    motion = wild_leg(seed)
    cubic, t, h = spline(motion), motion.times, np.diff(motion.times)
    assert motion.step == pytest.approx(h[:, None])
    begin, end = motion.acceleration
    inner = 1e-9 * h
    assert begin == pytest.approx(cubic(t[:-1] + inner, 2), abs=1e-4)
    assert end == pytest.approx(cubic(t[1:] - inner, 2), abs=1e-4)
    assert motion.jerk == pytest.approx(cubic(t[:-1] + 0.5 * h, 3), rel=1e-9)
    for time in np.concatenate([t, t[:-1] + 0.3 * h]):
        assert motion.at(float(time)) == pytest.approx(cubic(time), abs=1e-12)
    finer = np.sort(np.concatenate([t, t[:-1] + 0.3 * h]))
    same = motion.at_times(finer)
    assert same.positions == pytest.approx(cubic(finer), abs=1e-12)
    assert same.velocities == pytest.approx(cubic(finer, 1), abs=1e-9)
    assert np.array_equal(same.times, finer)
    # Resampled, it is the same cubic: the bounds of its pieces stay the same in sum.
    assert same.greatest_velocity.max(axis=0) == pytest.approx(
        motion.greatest_velocity.max(axis=0), abs=1e-9
    )


@pytest.mark.parametrize("seed", range(4))
def test_extremes_of_every_piece_are_those_at_its_turning_points(seed: int) -> None:
    motion = wild_leg(seed)
    low, high = motion.position_extremes()
    assert low.shape == high.shape == (len(motion.times) - 1, JOINTS)
    for i, (begin, end) in enumerate(zip(motion.times, motion.times[1:], strict=False)):
        for axis in range(JOINTS):
            rows = slice(i, i + 2)
            piece = CubicHermiteSpline(
                motion.times[rows], motion.positions[rows, axis], motion.velocities[rows, axis]
            )
            turns = [piece.derivative(k).roots(extrapolate=False) for k in (1, 2)]
            at = [np.clip(np.concatenate([[begin, end], roots]), begin, end) for roots in turns]
            assert low[i, axis] == pytest.approx(piece(at[0]).min(), abs=1e-12)
            assert high[i, axis] == pytest.approx(piece(at[0]).max(), abs=1e-12)
            fastest = np.abs(piece(at[1], 1)).max()
            assert motion.greatest_velocity[i, axis] == pytest.approx(fastest, rel=1e-9)
            most = np.abs(piece([begin, end - 1e-12], 2)).max()
            assert motion.greatest_acceleration[i, axis] == pytest.approx(most, rel=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_motion_of_constant_velocity_and_of_constant_acceleration(sign: float) -> None:
    """Degenerate cubics: no root, and one root."""
    steady = leg([0.0, 0.5], {2: [0.0, sign * 1.0]}, {2: [sign * 2.0] * 2})
    low, high = steady.position_extremes()
    assert (low[0, 2], high[0, 2]) == (min(0.0, sign), max(0.0, sign))
    assert steady.greatest_velocity[0, 2] == pytest.approx(2.0)
    thrown = leg([0.0, 2.0], {2: [0.0, 0.0]}, {2: [sign * 3.0, -sign * 3.0]})
    low, high = thrown.position_extremes()
    apex = sign * 1.5  # v^2 / (2 a), a = 3
    assert (low[0, 2], high[0, 2]) == pytest.approx((min(0.0, apex), max(0.0, apex)))
    assert thrown.greatest_acceleration[0, 2] == pytest.approx(3.0)


# Legs of a plan.


def test_legs_are_the_segments_and_the_strokes_between(rest: FlatteningPlan) -> None:
    found = legs(rest, OPENING)
    assert [each.name for each in found] == ["approach", "grippers", "pull", "grippers", "release"]
    assert [(each.times[0], each.times[-1]) for each in found] == [
        (0.0, 2.0),
        (2.0, 2.5),
        (2.5, 3.5),
        (3.5, 4.0),
        (4.0, 6.0),
    ]
    assert [each.held for each in found] == [False, True, True, True, False]
    assert [each.contact for each in found] == [
        (1.0, 2.0),
        (2.0, 2.5),
        (2.5, 3.5),
        (3.5, 4.0),
        (4.0, 5.0),
    ]
    openings = [[OPENING] * 2, [OPENING, 0.0], [0.0, 0.0], [0.0, OPENING], [OPENING] * 2]
    for each, (begin, end) in zip(found, openings, strict=True):
        assert each.positions[0, 13:] == pytest.approx([begin, begin])
        assert each.positions[-1, 13:] == pytest.approx([end, end])
        assert each.velocities[:, 13:] == pytest.approx((end - begin) / 0.5, abs=1e-12)
        assert not each.velocities[:, :13].any()


def test_each_blade_follows_its_own_gripper(rest: FlatteningPlan) -> None:
    first, pull, last = rest.segments
    right = dc.replace(rest, segments=(first, dc.replace(pull, closed=(True, False)), last))
    _, stroke, holding, opening, _ = legs(right, OPENING)
    assert stroke.positions[:, 13:] == pytest.approx(np.array([[OPENING, OPENING], [0.0, OPENING]]))
    assert stroke.velocities[:, 13:] == pytest.approx(np.tile([-OPENING / 0.5, 0.0], (2, 1)))
    assert holding.held and stroke.held and opening.held


def test_axes_stand_in_a_stroke_where_the_segment_before_ended(rest: FlatteningPlan) -> None:
    first, *others = rest.segments
    t = first.trajectory
    moved = t.positions + np.linspace(0.0, 1.0, 3)[:, None] * np.arange(13)
    first = dc.replace(first, trajectory=dc.replace(t, positions=moved))
    found = legs(dc.replace(rest, segments=(first, *others)), OPENING)
    assert found[0].positions[:, :13] == pytest.approx(moved)
    assert found[1].positions[:, :13] == pytest.approx(np.tile(np.arange(13.0), (2, 1)))


@pytest.mark.parametrize(
    ("index", "contact", "touching"),
    [
        (0, (1.0, 2.0 - 0.5e-6), True),
        (0, (1.0, 2.0 - 2e-6), False),
        (1, (0.5e-6, 1.0), True),
        (1, (2e-6, 1.0), False),
        (0, (2.0, 2.0), False),
        (1, (0.0, 0.0), False),
    ],
)
def test_fingers_touch_in_a_stroke_where_they_do_before_and_after(
    rest: FlatteningPlan, index: int, contact: tuple[float, float], touching: bool
) -> None:
    segments: list[Segment] = list(rest.segments)
    segments[index] = dc.replace(segments[index], contact=contact)
    found = legs(dc.replace(rest, segments=tuple(segments)), OPENING)
    assert found[1].contact == ((2.0, 2.5) if touching else None)
    assert (found[2 * index].contact is None) == (contact[0] >= contact[1])


def test_a_stroke_without_time_takes_a_millisecond(rest: FlatteningPlan) -> None:
    first, pull, last = rest.segments
    early = dc.replace(rest, segments=(first, dc.replace(pull, start=1.9), last))
    stroke = legs(early, OPENING)[1]
    assert stroke.times == pytest.approx([2.0, 2.001])
    assert stroke.velocities[:, 13:] == pytest.approx(-OPENING / 1e-3)
