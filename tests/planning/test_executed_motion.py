"""What a measured motion is said to have been."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.closed_loop.executed_motion import MeasuredSegment, check_execution
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.verification.verifier import verify


@pytest.fixture(scope="module")
def plan(
    planner: FlatteningPlanner, make_target: Callable[..., FlatteningTarget]
) -> FlatteningPlan:
    result = planner.plan(make_target(phi=0.3)).plan
    assert result is not None and result.dual
    return result


def measured(plan: FlatteningPlan, cell: Cell, lag: float = 0.0) -> list[MeasuredSegment]:
    """The plan as arms would run it that follow late by a lag, s."""
    found = []
    for segment in plan.segments:
        cubic = segment.trajectory.interpolant()
        times = np.arange(0.0, segment.trajectory.duration, 0.004)
        late = np.maximum(times - lag, 0.0)
        opening = [0.0 if closed else cell.scenario.gripper.opening for closed in segment.closed]
        found.append(
            MeasuredSegment(
                segment.name,
                times,
                cubic(late),
                cubic(late, 1) * (times >= lag)[:, None],
                cubic(times),
                np.tile(opening, (len(times), 1)),
            )
        )
    return found


def test_a_late_motion_is_told_from_a_wrong_one(plan: FlatteningPlan, cell: Cell) -> None:
    check = check_execution(plan, cell, measured(plan, cell, lag=0.008))
    assert check.lag == pytest.approx(0.008, abs=5e-5)
    assert check.error > 5e-3
    assert check.error_after_lag < 5e-5
    assert check.grip_distance_error < 2e-5
    assert check.violations == ()


def test_segments_that_began_late_by_different_times_are_no_errors(
    plan: FlatteningPlan, cell: Cell
) -> None:
    """One lag for all segments called the rest of each an error of up to 9 mrad."""
    lags = (0.0043, 0.0217, 0.0101)
    late = [measured(plan, cell, lag)[k] for k, lag in enumerate(lags)]
    check = check_execution(plan, cell, late)
    assert check.lag == pytest.approx(max(lags), abs=5e-5)
    assert check.error > 2e-2 and check.error_after_lag < 5e-5
    assert check.grip_distance_error < 1e-4


def test_the_clearance_is_the_one_of_the_verdict(plan: FlatteningPlan, cell: Cell) -> None:
    smallest = verify(plan, cell).smallest
    check = check_execution(plan, cell, measured(plan, cell))
    assert smallest is not None and check.clearance is not None
    assert check.clearance == pytest.approx(smallest.distance, abs=1e-3)
    assert check.clearance_pair == smallest.bodies


def test_an_axis_that_errs_is_named(plan: FlatteningPlan, cell: Cell) -> None:
    segments = measured(plan, cell)
    pull = segments[1]
    positions = pull.positions.copy()
    positions[:, 4] += 0.003 * np.sin(9.0 * pull.times)
    segments[1] = dc.replace(pull, positions=positions)
    check = check_execution(plan, cell, segments)
    assert check.worst_axis == cell.robot.axes[4]
    assert 0.002 < check.error_after_lag < 0.0035
    assert 0.5e-3 < check.grip_distance_error < 5e-3


def test_broken_limits_and_clearances_are_violations(plan: FlatteningPlan, cell: Cell) -> None:
    segments = measured(plan, cell)
    approach = segments[0]
    velocities = approach.velocities.copy()
    velocities[10, 2] = 1.1 * cell.limits.velocity[2]
    positions = approach.positions.copy()
    positions[20:, 0] += 1.0  # the turn-table swings the arms into the other table
    broken = dc.replace(approach, velocities=velocities, positions=positions)
    messages = " ".join(check_execution(plan, cell, [broken]).violations)
    assert cell.robot.axes[2] in messages and "rad/s" in messages
    assert "collide" in messages or "less than" in messages or "cannot be bounded" in messages


def test_nothing_measured_is_refused(plan: FlatteningPlan, cell: Cell) -> None:
    with pytest.raises(InputError, match="no measured motion"):
        check_execution(plan, cell, [])


@pytest.mark.parametrize("fault", ["nan", "shape", "time"])
def test_bad_measurements_are_refused(plan: FlatteningPlan, cell: Cell, fault: str) -> None:
    segment = measured(plan, cell)[0]
    changes = {
        "nan": {"velocities": np.full_like(segment.velocities, np.nan)},
        "shape": {"reference": segment.reference[:, :12]},
        "time": {"times": segment.times[::-1].copy()},
    }
    with pytest.raises(InputError, match="measured approach"):
        dc.replace(segment, **changes[fault])
