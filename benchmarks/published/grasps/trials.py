"""Trials of the benchmark `grasps`: one state from one seed, pinched and lifted at several points."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.trials import Trial
from benchmarks.published.grasps.results import Attempt, GraspRun
from benchmarks.published.grasps.states import cloth_of, start_of, state_named
from benchmarks.published.loop_trials import VERTICES
from unwrinkle.models.arrays import Array
from unwrinkle.models.io.archive import save_archive
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.perception.wrinkles.grasp_proposal import (
    GraspProposal,
    NoGrasp,
    across_direction,
    propose_grasp,
)
from unwrinkle.planning.primitives.pinch import NoPinch, PinchPlan, PinchPlanner
from unwrinkle.simulation.cloth.cloth import Cloth, ClothError, ClothState
from unwrinkle.simulation.cloth.measures import measure
from unwrinkle.simulation.cloth.pinch_grasp import Catch, Lift, catch, lift
from unwrinkle.systems.perception.true_range_map import true_range_map

OURS = "wrinkledness"
CHOICES = (OURS, "largest wrinkle", "highest point", "random point")
#: A lift that takes up less cloth than this has not grasped the garment, m^2.
LEAST_AREA = 1e-3
#: How high what is caught is lifted, m.
LIFT = 0.10
#: Misplacements of the tool on the table that a catch is tried with besides, m, in eight directions
#: each.
MISPLACED = (0.005, 0.010)

Place = tuple[Array, Array]  # p_WG (3,), across (2,)


def wanted(states: Sequence[str], seeds: Sequence[int]) -> list[Trial]:
    """Return a trial per state and seed; all points of one are tried from the same start and look."""
    work = "benchmarks.published.grasps.trials:grasped"
    return [
        Trial(f"{state}-{seed}", work, {"state": state, "seed": seed})
        for state in states
        for seed in seeds
    ]


def grasped(settings: dict[str, Any], folder: Path) -> GraspRun:
    """Look at a state, and pinch and lift it at each point, always from the same start.

    Args:
        settings: `state` (of `states`) and `seed`, of the start, the look's noise and the
            random point.
        folder: takes the start (`start.npz`) and, for pictures, the vertices before and after our
            lift (`vertices.npz`).
    """
    cell, planner = _station()
    kind, seed = state_named(settings["state"]), int(settings["seed"])
    cloth = cloth_of(kind, cell)
    start = start_of(kind, cloth, cell, seed, folder / "start.npz")
    truth = measure(cloth, start)
    analysis = analyse(true_range_map(cloth, start, seed), table=cell.table)
    rim = _rim_distance(analysis)
    tried: dict[str, Attempt] = {}
    lifted = start
    for choice in CHOICES:
        place = _place(analysis, choice, np.random.default_rng([seed, 1]))
        tried[choice], ended = _attempt(cloth, start, place, planner)
        if not isinstance(place, NoGrasp):
            column, row = np.rint(analysis.range_map.cell_from_world(place[0][:2])).astype(int)
            tried[choice] = dataclasses.replace(tried[choice], inset=float(rim[row, column]))
        if choice == OURS and ended is not None:
            lifted = ended.state
    if isinstance(proposal := _proposal(analysis), GraspProposal):
        tried[OURS] = dataclasses.replace(tried[OURS], proposal=proposal.to_json())
    vertices = [cloth.vertices(state).astype(np.float32) for state in (start, lifted)]
    save_archive(
        folder / VERTICES,
        {"flat_height": cloth.flat_height},
        {"v0": vertices[0], "v1": vertices[1], "triangles": cloth.triangles},
    )
    return GraspRun(
        wrinkles=len(analysis.wrinkles), coverage=truth.coverage, height=truth.height, choices=tried
    )


@cache
def _station() -> tuple[Cell, PinchPlanner]:
    cell = load_cell()
    return cell, PinchPlanner(cell)


def _rim_distance(analysis: Analysis) -> NDArray[np.float32]:
    """How far every cell of the range map lies inside the garment's outline, m; 0 outside."""
    mask = analysis.range_map.garment.astype(np.uint8)
    away: NDArray[np.float32] = np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, 5))
    return away * np.float32(analysis.range_map.resolution)


def _proposal(analysis: Analysis) -> GraspProposal | NoGrasp:
    table = analysis.range_map.table_height
    return propose_grasp(analysis.surface, analysis.wrinkledness, analysis.profile, table)


def _place(analysis: Analysis, choice: str, rng: np.random.Generator) -> Place | NoGrasp:
    """Where to pinch and in which direction.

    The other points are pinched across the sharpest convex bending there.
    """
    surface, table = analysis.surface, analysis.range_map.table_height
    if choice == OURS:
        proposal = _proposal(analysis)
        return proposal if isinstance(proposal, NoGrasp) else (proposal.p_WG, proposal.across)
    if choice == "largest wrinkle":
        if not analysis.wrinkles:
            return NoGrasp("no wrinkle was found")
        cell = surface.cells(analysis.wrinkles[0].centre)
        column, row = np.rint(cell).astype(int).tolist()
    elif choice == "highest point":
        z = np.where(surface.inside, surface.z, -np.inf)
        row, column = np.unravel_index(int(np.argmax(z)), z.shape)
    else:
        row, column = rng.choice(np.argwhere(surface.inside))
    point = surface.world(np.array([column, row], dtype=float))
    p_WG = np.array([*point, float(surface.z[row, column]) + table])
    return p_WG, across_direction(surface, point)


def _attempt(
    cloth: Cloth, start: ClothState, place: Place | NoGrasp, planner: PinchPlanner
) -> tuple[Attempt, Lift | None]:
    """Plan, pinch and lift at a place; what came of it, with the cause where it failed."""
    if isinstance(place, NoGrasp):
        return _failed("no ridge", place.reason), None
    plan = planner.plan(*place)
    if isinstance(plan, NoPinch):
        return _failed(plan.cause, plan.reason), None
    held = catch(cloth, start, plan.X_WT, planner.blades, planner.opening)
    report: dict[str, Any] = {
        "arm": plan.arm,
        "turntable": plan.turntable,
        "tilt": plan.tilt,
        "offset": plan.offset,
        "tips": _tips(held, planner),
        "withheld": held.withheld,
        "layers": held.layers,
        "pressed": held.pressed,
        "depth": held.depth,
        "nodes": len(held.nodes),
        "misplaced": _misplaced(cloth, start, plan, planner),
    }
    if not held.caught:
        return _failed("not caught", held.reason, report), None
    try:
        ended = lift(cloth, start, held, hand=plan.arm, height=LIFT)
    except ClothError as error:
        return _failed("solver", str(error), report), None
    report |= {"area": ended.area, "weight": ended.weight}
    if ended.area < LEAST_AREA:
        text = f"only {1e4 * ended.area:.1f} cm2 were lifted"
        return _failed("not lifted", text, report), ended
    return Attempt(success=True, **report), ended


def _failed(cause: str, reason: str, report: Mapping[str, Any] | None = None) -> Attempt:
    return Attempt(success=False, cause=cause, reason=reason, **(report or {}))


def _tips(held: Catch, planner: PinchPlanner) -> list[list[list[float]]]:
    """World x, y of the ends of either blade's tip, (2, 2, 2)."""
    blades, half = planner.blades, 0.5 * planner.blades.width
    outer = 1.5 * blades.thickness + planner.opening
    ends = ((0.5 * blades.thickness, blades.lower_end), (outer, blades.upper_end))
    p_TQ = np.array([[[x, y, z, 1.0] for x in (-half, half)] for y, z in ends])
    lines: list[list[list[float]]] = (p_TQ @ held.X_WT.T)[..., :2].tolist()
    return lines


def _misplaced(
    cloth: Cloth, start: ClothState, plan: PinchPlan, planner: PinchPlanner
) -> tuple[float, ...]:
    """For each of MISPLACED the share of eight directions in which the blades still catch cloth."""
    shares = []
    for distance in MISPLACED:
        hits = 0
        for angle in np.arange(8) * (0.25 * np.pi):
            X_WT = plan.X_WT.copy()
            X_WT[:2, 3] += distance * np.array([np.cos(angle), np.sin(angle)])
            hits += catch(cloth, start, X_WT, planner.blades, planner.opening).caught
        shares.append(hits / 8)
    return tuple(shares)
