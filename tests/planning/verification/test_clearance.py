"""Clearances at the edges of what is required, in motions that rest or that no bound can follow."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.verification.clearance import ClearanceReport, check_clearances
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings, PairClearance

from .built import kinds_of, leg, times_of

KINDS = ("arm-arm", "palm-table", "surroundings")


def with_clearance(cell: Cell, kind: str, required: float) -> CellModel:
    changed = dc.replace(cell.scenario.clearance, **{kind.replace("-", "_"): required})
    return CellModel(dc.replace(cell, scenario=dc.replace(cell.scenario, clearance=changed)))


def at_rest(posture: Array, name: str = "approach", **fields: object) -> Leg:
    still = leg([0.0, 1.0, 2.0], name=name, **fields)  # type: ignore[arg-type]
    return dc.replace(still, positions=np.tile(np.append(posture, [0.0, 0.0]), (3, 1)))


def check(
    model: CellModel, motion: Leg, part: tuple[bool, bool] = (True, True)
) -> tuple[Findings, ClearanceReport]:
    found = Findings()
    frames = model.frames(motion.positions)[0]
    return found, check_clearances(model, [motion], [frames], part, found)


def nearest(report: ClearanceReport, kind: str) -> PairClearance:
    return min(
        (pair for pair in report.clearances if pair.kind == kind), key=lambda pair: pair.distance
    )


@pytest.fixture(scope="module")
def low(planner: FlatteningPlanner, make_target: Callable[..., FlatteningTarget]) -> Array:
    """A posture in which both hands are at the table, near each other."""
    plan = planner.plan(make_target(phi=0.5, half=0.05, pull=0.02)).plan
    assert plan is not None
    return np.array(plan.segments[0].trajectory.positions[-1])


@pytest.mark.parametrize("kind", KINDS)
def test_the_required_distance_is_kept_at_every_sample(cell: Cell, low: Array, kind: str) -> None:
    """The millimetre that may be missing between samples is not missing at one."""
    motion = at_rest(low)
    far = with_clearance(cell, kind, 0.140)
    _, report = check(far, motion)
    distance = nearest(report, kind).distance
    for required, broken in ((distance - 5e-5, False), (distance + 5e-4, True)):
        found, report = check(with_clearance(cell, kind, required), motion)
        assert kinds_of(found) - {"finger_table"} == ({"clearance"} if broken else set())
        if broken:
            pair = nearest(report, kind)
            message = next(each.message for each in found.violations if each.kind == "clearance")
            assert all(name in message for name in pair.bodies) and kind in message


def test_a_motion_that_no_bound_can_follow_is_refused(cell: Cell, model: CellModel) -> None:
    """Wild rates between two samples so near each other that nothing can be halved."""
    home = np.append(cell.robot.named_states["home"], [0.0, 0.0])
    wild = leg([0.0, 1e-5], name="approach")
    wild = dc.replace(
        wild, positions=np.tile(home, (2, 1)), velocities=np.tile(1e6 * np.ones(15), (2, 1))
    )
    found, _ = check(model, wild)
    assert kinds_of(found) <= {"clearance", "finger_table"} and "clearance" in kinds_of(found)
    assert set(times_of(found, "clearance")) == {0.0}
    assert any("cannot be bounded well enough" in each.message for each in found.violations)
