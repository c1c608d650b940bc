"""Joint limits at their edges: the value that the motion uses passes, a little less does not."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.robot import Cell
from unwrinkle.planning.verification.joint_limits import check_limits
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings

from .built import AXES, kinds_of, leg, times_of, wild_leg

NAMES = [f"axis {i}" for i in range(AXES)]
PLENTY = 1e6
RATES = ("velocity", "acceleration", "jerk")


def limits_of(cell: Cell, axis: int = 0, **changed: float) -> Limits:
    """Limits that nothing reaches, but for one axis."""
    fields: dict[str, Array] = {
        name: np.full(AXES, -PLENTY if name == "lower" else PLENTY)
        for name in ("lower", "upper", *RATES)
    }
    for name, value in changed.items():
        fields[name][axis] = value
    return dc.replace(cell.limits, **fields)


def check(limits: Limits, *motion: Leg) -> Findings:
    found = Findings()
    check_limits(motion, limits, NAMES, found)
    return found


def extremes(motion: Leg, name: str) -> Array:
    """Greatest absolute value in every interval, (n-1, 13); against scipy in test_motion.py."""
    if name == "velocity":
        return motion.greatest_velocity[:, :AXES]
    if name == "acceleration":
        return motion.greatest_acceleration[:, :AXES]
    return np.abs(motion.jerk)[:, :AXES]


@pytest.mark.parametrize("axis", [0, 6, 12])
@pytest.mark.parametrize("name", RATES)
def test_an_axis_keeps_its_limit_exactly(cell: Cell, name: str, axis: int) -> None:
    motion = wild_leg(axis)
    values = extremes(motion, name)[:, axis]
    worst, at = values.max(), float(motion.times[values.argmax()])
    # The jump of acceleration is judged by the limit of the jerk too.
    rest = {"acceleration_jump"} if name == "jerk" else set()
    for factor, broken in ((1.0 + 1e-12, False), (1.0 - 1e-6, True)):
        found = check(limits_of(cell, axis, **{name: factor * worst}), motion)
        assert kinds_of(found) - rest == ({name} if broken else set())
        result = next(each for each in found.checks() if each.name == name)
        assert (result.where, result.time, result.limit) == (NAMES[axis], at, 1.0)
        assert result.value == pytest.approx(1.0 / factor, rel=1e-9)
        assert result.margin == pytest.approx(1.0 - 1.0 / factor, abs=1e-9)
        assert result.passed != broken and result.unit == ""
        assert times_of(found, name) == ([at] if broken else [])


@pytest.mark.parametrize("axis", [0, 5, 12])
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_an_axis_stays_between_its_positions_exactly(cell: Cell, side: str, axis: int) -> None:
    motion = wild_leg(axis + 20)
    low, high = (p[:, axis] for p in motion.position_extremes())
    worst, at = (low.min(), low.argmin()) if side == "lower" else (high.max(), high.argmax())
    outwards = -1.0 if side == "lower" else 1.0
    for room, broken in ((0.0, False), (0.5e-9, False), (-0.5e-9, False), (-2e-9, True)):
        found = check(limits_of(cell, axis, **{side: worst + outwards * room}), motion)
        assert kinds_of(found) == ({"position"} if broken else set())
        result = next(each for each in found.checks() if each.name == "position")
        assert (result.where, result.unit) == (NAMES[axis], "rad")
        assert result.value == pytest.approx(worst, abs=1e-12)
        assert result.limit == pytest.approx(worst + outwards * room, abs=1e-12)
        assert result.margin == pytest.approx(room, abs=1e-12)
        assert result.time == motion.times[at]
        assert times_of(found, "position") == ([motion.times[at]] if broken else [])


def test_every_axis_beyond_its_limit_is_told(cell: Cell) -> None:
    motion = leg([0.0, 1.0], {k: [0.0, 0.1 * (k + 1)] for k in range(AXES)})
    narrow = dc.replace(
        cell.limits,
        lower=np.full(AXES, -1.0),
        upper=np.full(AXES, 0.55),
        velocity=np.full(AXES, PLENTY),
        acceleration=np.full(AXES, PLENTY),
        jerk=np.full(AXES, PLENTY),
    )
    found = check(narrow, motion)
    assert [violation.kind for violation in found.violations] == ["position"] * 8
    result = found.checks()[0]
    assert (result.where, result.margin) == ("axis 12", pytest.approx(-0.75))


def test_the_worst_of_several_legs_counts(cell: Cell) -> None:
    """In either order; strokes of the grippers do not count."""
    slow, fast = wild_leg(1), wild_leg(2)
    fast = dc.replace(fast, times=fast.times + 10.0, velocities=50.0 * fast.velocities)
    stroke = dc.replace(fast, name="grippers", velocities=50.0 * fast.velocities)
    worst = extremes(fast, "velocity")
    for order in ((slow, fast, stroke), (stroke, fast, slow)):
        found = {each.name: each for each in check(limits_of(cell), *order).checks()}
        at = np.unravel_index(worst.argmax(), worst.shape)
        assert found["velocity"].value == pytest.approx(worst.max() / PLENTY)
        assert found["velocity"].where == NAMES[at[1]]
        assert found["velocity"].time == fast.times[at[0]]
        assert set(found) == {"position", *RATES, "acceleration_jump"}


@pytest.mark.parametrize("axis", [0, 4, 12])
def test_what_is_no_number_keeps_no_limit(cell: Cell, axis: int) -> None:
    motion = wild_leg(3)
    positions = motion.positions.copy()
    positions[2, axis] = np.nan
    found = check(limits_of(cell), motion, dc.replace(motion, positions=positions), motion)
    assert kinds_of(found) == {"position", *RATES, "acceleration_jump"}
    assert {each.where for each in found.checks()} == {NAMES[axis]}


# Jumps of acceleration: 8/27 J of the intervals on both sides.


@pytest.mark.parametrize("axis", [0, 12])
@pytest.mark.parametrize("end", ["begin", "end"])
def test_a_jump_at_rest(cell: Cell, axis: int, end: str) -> None:
    """From rest to rest by d in h: 6 d / h^2 at both ends, beside one interval of h only."""
    d, h = 0.3, 0.5
    back = leg([0.0, h, h + 2.0], {axis: [0.0, d, d]})
    there = leg([0.0, 2.0, 2.0 + h], {axis: [0.0, 0.0, d]})
    motion, at = (back, 0.0) if end == "begin" else (there, 2.0 + h)
    edge = 6.0 * d / h**2 / (8.0 / 27.0 * h)
    for factor, broken in ((1.0 + 1e-12, False), (1.0 - 1e-6, True)):
        found = check(limits_of(cell, axis, jerk=factor * edge), motion)
        assert kinds_of(found) == ({"acceleration_jump"} if broken else set())
        assert times_of(found, "acceleration_jump") == ([at] if broken else [])
        result = next(each for each in found.checks() if each.name == "acceleration_jump")
        assert (result.where, result.time) == (NAMES[axis], at)
        assert result.value == pytest.approx(1.0 / factor, rel=1e-9)


def test_a_jump_between_uneven_pieces(cell: Cell) -> None:
    """Jerk j over h, then from -b to rest over k: the acceleration jumps by j h + b in between."""
    j, h, k = 1.0, 1.0, 2.0
    v = 0.5 * j * h**2
    b = 2.0 * v / k
    p = j * h**3 / 6.0
    motion = leg([0.0, h, h + k], {3: [0.0, p, p + v * k - b * k**2 / 3.0]}, {3: [0.0, v, 0.0]})
    edge = (j * h + b) / (8.0 / 27.0 * (h + k))
    for factor, broken in ((1.0 + 1e-12, False), (1.0 - 1e-6, True)):
        found = check(limits_of(cell, 3, jerk=factor * edge), motion)
        assert kinds_of(found) == ({"acceleration_jump"} if broken else set())
        assert times_of(found, "acceleration_jump") == ([h] if broken else [])
