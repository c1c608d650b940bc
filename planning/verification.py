"""Independent verification of a flattening plan: the very samples that are sent, and all that lies between them.

Shares nothing with the planner but the models and the plan's types. What is proven of a plan that passes, for the cubic
motion that the controller makes of the samples, with Drake's model of the cell:

- position, velocity, acceleration and jerk of every axis keep their limits at every time (exact extremes), and acceleration
  jumps between cubic pieces by no more than a motion of that jerk allows;
- every pair of bodies that move against each other keeps its padding at every sample (to 0.01 mm), and nowhere between
  samples comes more than 1 mm below it, nor into contact; the strokes of the grippers included. Fingers meet the working table
  only in the contact windows, and then sink into it by no more than 0.1 mm anywhere;
- tool centre points keep the speed limit, and the grippers their greatest distance, at every time while cloth is held;
- segments, gripper events, start, rest, continuity and hashes are what they have to be.

It assumes rigid bodies of exactly the modelled shapes, exact tracking, the stereo head resting at the scenario's gaze, both
grippers open at the start, and takes no notice of the garment.
"""

import logging
import time
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification_clearance import ClearanceReport, check_clearances
from unwrinkle.planning.verification_hands import check_hands
from unwrinkle.planning.verification_limits import check_limits
from unwrinkle.planning.verification_model import CellModel
from unwrinkle.planning.verification_motion import legs
from unwrinkle.planning.verification_structure import (
    check_grippers,
    check_identity,
    check_rest,
    check_structure,
)
from unwrinkle.planning.verification_verdict import Findings, Verdict

_log = logging.getLogger(__name__)

# Building a cell's model takes as long as a verification.
_models: WeakKeyDictionary[Cell, CellModel] = WeakKeyDictionary()


def verify(plan: FlatteningPlan, cell: Cell, *, start: ArrayLike | None = None) -> Verdict:
    """Check a plan and say what was found.

    Args:
        plan: what is to be executed.
        cell: where. Its limits count at the plan's speed fraction, which may not exceed the scenario's.
        start: (13,) where the robot stands, rad; home if left out.

    Returns:
        A verdict; a bad plan is a value with violations, not an exception.

    Raises:
        InputError: `start` is not 13 finite numbers, or the cell's models do not fit together.
    """
    clock = time.perf_counter()
    home = cell.robot.named_states["home"]
    standing = np.array(home if start is None else start, dtype=float)
    if standing.shape != (13,) or not np.all(np.isfinite(standing)):
        raise InputError(f"the start has shape {standing.shape}, expected 13 finite numbers")
    # The same cell at the same speed is kept as it is, since it may hold limits of its own.
    slower = cell if plan.speed == cell.scenario.speed else cell.with_speed(plan.speed)
    found = Findings()
    check_identity(plan, cell, slower.limits_hash, found)
    check_structure(plan, found)
    report = ClearanceReport((), 0.0, 0)
    if plan.segments:
        check_rest(plan, standing, found)
        check_grippers(plan, slower, found)
        motion = legs(plan, cell.scenario.gripper.opening)
        check_limits(motion, slower.limits, cell.robot.axes, found)
        model = cell_model(cell)
        frames = [model.frames(leg.positions) for leg in motion]
        check_hands(plan, slower, model, motion, frames, found)
        taking_part = (plan.arms[0] is not None, plan.arms[1] is not None)
        report = check_clearances(model, motion, [X for X, _ in frames], taking_part, found)
    verdict = Verdict(
        plan_hash=plan.content_hash,
        robot_hash=cell.robot_hash,
        limits_hash=slower.limits_hash,
        checks=found.checks(),
        violations=tuple(found.violations),
        clearances=report.clearances,
        elsewhere=report.elsewhere,
        queries=report.queries,
    )
    duration = time.perf_counter() - clock
    _log.info("%s; %d configurations, %.3f s", verdict.summary(), report.queries, duration)
    return verdict


def cell_model(cell: Cell) -> CellModel:
    """The verification's model of a cell, built once per cell."""
    if cell not in _models:
        _models[cell] = CellModel(cell)
    return _models[cell]
