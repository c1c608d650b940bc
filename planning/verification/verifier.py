"""Independent verification of a flattening plan against the model of the cell.

It shares only the models and the plan's types with the planner. The motion that is verified is the
cubic interpolation of the samples as the controller takes them (whole milliseconds, float32, in
every profile). For a plan that passes, the following holds for that motion in Drake's model of the
cell:

- position, velocity, acceleration and jerk of every axis keep their limits at every time (exact
  extremes), and the acceleration jumps between cubic pieces by no more than a motion of that jerk
  allows;
- every pair of bodies that move against each other keeps its clearance at every sample (to 0.01
  mm); between samples it is at no time more than 1 mm below it, and never in contact; gripper
  strokes are included. Fingers touch the working table in contact windows only, in which the tools
  are at the place of work, and penetrate it by no more than 0.1 mm;
- during contact and holding the tools have the posture that the plan states, within the gripper's
  window, and the turn-table has the angle that the plan states; while cloth is held the tools stay
  on the line of the pull, below the holding height and the speed limit, and the grippers below
  their greatest distance; open fingers near the table keep their speed limits;
- grasp, pull and put-down points lie on the working table;
- segments, gripper events, named poses, start, rest, continuity and hashes are as required.

Assumptions: rigid bodies of exactly the modelled shapes, exact tracking, the stereo head at rest at
the scenario's gaze, both grippers open at the start. The garment is not modelled. The work is
bounded: a plan that exceeds the bound is refused.
"""

import logging
import time
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.clearance import ClearanceReport, check_clearances
from unwrinkle.planning.verification.contact import check_contact
from unwrinkle.planning.verification.hands import check_hands
from unwrinkle.planning.verification.joint_limits import check_limits
from unwrinkle.planning.verification.kinematics import check_kinematics
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.motion import legs
from unwrinkle.planning.verification.postures import check_postures
from unwrinkle.planning.verification.structure import (
    check_choice,
    check_grippers,
    check_identity,
    check_numbers,
    check_rest,
    check_sent,
    check_speed,
    check_structure,
)
from unwrinkle.planning.verification.tools import tool_legs
from unwrinkle.planning.verification.verdict import Findings, Verdict

_log = logging.getLogger(__name__)

# Building the model of a cell takes about as long as one verification.
_models: WeakKeyDictionary[Cell, CellModel] = WeakKeyDictionary()


def verify(plan: FlatteningPlan, cell: Cell, *, start: ArrayLike | None = None) -> Verdict:
    """Verify a plan against the model of a cell.

    Args:
        plan: to be executed.
        cell: the robot in its cell. Its limits are taken at the plan's speed fraction, which may
            not exceed the scenario's.
        start: (axes,) configuration in which the robot stands, rad; home if left out.

    Returns:
        A verdict; a plan that fails gives violations, not an exception.

    Raises:
        InputError: `start` is not one finite number per axis, or the cell's models do not fit
            together.
    """
    clock = time.perf_counter()
    home = cell.robot.named_states["home"]
    standing = np.array(home if start is None else start, dtype=float)
    count = len(cell.robot.axes)
    if standing.shape != (count,) or not np.all(np.isfinite(standing)):
        raise InputError(f"the start has shape {standing.shape}, expected {count} finite numbers")
    found = Findings()
    check_numbers(plan, found)
    # At the same speed the cell itself is used, since its limits may differ from those of its
    # files.
    report, slower = ClearanceReport((), 0.0, 0), cell
    if not found.failed("numbers"):
        check_speed(plan, cell, found)
        if 0.0 < plan.speed <= 1.0 and plan.speed != cell.scenario.speed:
            slower = cell.with_speed(plan.speed)
    check_identity(plan, cell, slower.limits_hash, found)
    if not found.failed("numbers"):
        report = _check_motion(plan, cell, slower, standing, found)
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


def _check_motion(
    plan: FlatteningPlan, cell: Cell, slower: Cell, standing: Array, found: Findings
) -> ClearanceReport:
    """Run all checks of a plan whose numbers are finite.

    Args:
        plan: the plan.
        cell: the robot in its cell.
        slower: the same cell with the limits at the plan's speed.
        standing: (axes,) configuration in which the robot stands, rad.
        found: receives checks and violations.

    Returns:
        Clearances; none where the plan breaks its joint limits.
    """
    check_structure(plan, found)
    check_choice(plan, found)
    nothing = ClearanceReport((), 0.0, 0)
    if not plan.segments:
        return nothing
    check_rest(plan, standing, found)
    check_grippers(plan, slower, found)
    sent = check_sent(plan, found)
    if sent is None:
        return nothing
    motion = legs(sent, cell.scenario.gripper.opening)
    check_limits(motion, slower.limits, cell.robot.axes, found)
    broken = found.failed("position", "velocity", "acceleration", "jerk")
    model = cell_model(cell)
    frames = [model.frames(leg.positions) for leg in motion]
    check_kinematics(cell, motion, frames, found)
    near = cell.scenario.tools.near_table
    tools = tool_legs(model, motion, frames, near, found, closely=not broken)
    check_hands(sent, slower, model, tools, found)
    check_postures(sent, cell, model, tools, found)
    check_contact(sent, cell, model, tools, found)
    if broken:
        return nothing
    taking_part = (plan.arms[0] is not None, plan.arms[1] is not None)
    return check_clearances(model, motion, [X for X, _ in frames], taking_part, found)


def cell_model(cell: Cell) -> CellModel:
    """Return the verification's model of a cell, built once per cell."""
    if cell not in _models:
        _models[cell] = CellModel(cell)
    return _models[cell]
