"""Plans as the planner made them pass the verification."""

from collections.abc import Callable

import pytest

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.search.failure import off_table
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.verification.verifier import verify

Targets = Callable[[int, int], list[FlatteningTarget]]


def assert_all_pass(
    planner: FlatteningPlanner, cell: Cell, targets: list[FlatteningTarget]
) -> None:
    refused = {}
    planned = 0
    for i, target in enumerate(targets):
        result = planner.plan(target)
        if result.plan is None:
            continue
        planned += 1
        verdict = verify(result.plan, cell)
        if not verdict.passed:
            refused[i] = [violation.message for violation in verdict.violations]
    assert refused == {}
    assert planned >= 0.9 * len(targets)


@pytest.mark.slow
def test_unchanged_plans_pass(
    planner: FlatteningPlanner, cell: Cell, random_targets: Targets
) -> None:
    assert_all_pass(planner, cell, random_targets(40, 11))


@pytest.mark.long
@pytest.mark.timeout(400)
def test_two_hundred_unchanged_plans_pass(
    planner: FlatteningPlanner, cell: Cell, random_targets: Targets
) -> None:
    assert_all_pass(planner, cell, random_targets(200, 12))


def test_pulls_to_the_stretch_limit_pass(
    planner: FlatteningPlanner, cell: Cell, random_targets: Targets
) -> None:
    further = [target.pulled_further(3.0, 0.05) for target in random_targets(8, 13)]
    further = [target for target in further if off_table(target, cell) is None]
    assert len(further) >= 6
    assert all(t.final_grip_distance > 1.09 * t.geodesic_distance for t in further)
    assert_all_pass(planner, cell, further)
