"""Plans that pass: what the verification refuses, the planner follows with its next motion."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.verification.verifier import verify

Maker = Callable[..., FlatteningTarget]


def with_sliding(cell: Cell, speed: float) -> Cell:
    """The cell with another limit of the speed of open fingers along the table."""
    tools = dc.replace(cell.scenario.tools, sliding_speed=speed)
    return load_cell(dc.replace(cell.scenario, tools=tools))


def test_a_good_plan_comes_with_its_verdict(
    planner: FlatteningPlanner, cell: Cell, make_target: Maker
) -> None:
    target = make_target(phi=0.3)
    found = plan_verified(planner, cell, target)
    assert found.result.plan is not None and found.verdict is not None
    assert found.verdict.passed and found.verdict.plan_hash == found.result.plan.content_hash
    assert found.refused == ()
    alone = planner.plan(target).plan
    assert alone is not None and alone.content_hash == found.result.plan.content_hash


def test_the_next_motion_is_tried_where_the_verdict_refuses(
    planner: FlatteningPlanner, cell: Cell, make_target: Maker
) -> None:
    """The planner knows no limit of the sliding speed; the verification of this cell does."""
    target = make_target(phi=0.3)
    first = planner.plan(target).plan
    assert first is not None
    value = verify(first, cell).check("sliding").value
    assert value is not None
    slower = with_sliding(cell, 0.99 * value)
    found = plan_verified(FlatteningPlanner(slower), slower, target, arms="dual")
    assert found.refused[0].plan_hash == first.content_hash
    assert {v.kind for verdict in found.refused for v in verdict.violations} == {"sliding"}
    assert found.verdict is not None and found.verdict.passed
    assert found.result.plan is not None and found.result.failure is None
    assert found.result.plan.arms != first.arms or found.result.plan.turntable != first.turntable
    assert found.result.timings.approval > 0.0


def test_where_every_plan_is_refused_the_reason_is_the_verdicts(
    cell: Cell, make_target: Maker
) -> None:
    none = with_sliding(cell, 1e-3)
    found = plan_verified(FlatteningPlanner(none), none, make_target(phi=0.3))
    assert found.result.plan is None and found.verdict is None
    assert found.result.failure is not None and found.result.failure.cause == "verification"
    assert "slides over the table" in found.result.failure.message
    # At most eight of each kind, fewer where the time is up before.
    assert 1 < len(found.refused) <= 16


def test_the_verdict_is_about_where_the_robot_stands(
    planner: FlatteningPlanner, cell: Cell, make_target: Maker
) -> None:
    start = np.zeros(13)
    start[[0, 1, 7]] = [0.2, 0.3, -0.3]
    found = plan_verified(planner, cell, make_target(), start=start)
    assert found.result.plan is not None and found.verdict is not None
    assert verify(found.result.plan, cell, start=start).passed
    assert not verify(found.result.plan, cell).passed


@pytest.mark.parametrize("arms", ["dual", "single"])
def test_arms_are_handed_on(
    planner: FlatteningPlanner, cell: Cell, make_target: Maker, arms: str
) -> None:
    found = plan_verified(planner, cell, make_target(phi=0.3), arms=arms)
    assert found.result.plan is not None and found.result.plan.dual == (arms == "dual")
