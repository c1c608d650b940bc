"""What the planner is compared with.

Drake's inverse kinematics in its search, OMPL's RRT-Connect.
"""

import time
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.planning.plans.results import DrakeFigures, RrtFigures
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.key_poses import POSES
from unwrinkle.planning.search.motion_search import MotionSearch, SevenPoseMotion
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.testing.drake_ik import DrakeInverseKinematics

_DRAKE_BUDGET = 30.0  # s for one task; the own search takes hundredths
_RRT_BUDGET = 5.0  # s for one of the eight legs
_RESOLUTION = 0.002  # of the space's extent, for OMPL's edge checks


def drake_baseline(cell: Cell, targets: list[FlatteningTarget]) -> DrakeFigures:
    """Run the same search with SNOPT solving each pose in place of the closed form."""
    settings = replace(PlannerSettings(), budget=_DRAKE_BUDGET)
    contact = CollisionModel(cell, contact=True)
    search = MotionSearch(cell, settings, DrakeInverseKinematics(cell), contact)
    times, found, late = [], 0, 0
    for target in targets:
        clock = time.perf_counter()
        motion, log = search.dual(target)
        times.append(time.perf_counter() - clock)
        found += motion is not None
        late += log.out_of_time
    return DrakeFigures(
        tasks=len(targets),
        dual_arm_success=found / len(targets),
        out_of_time=late,
        budget=_DRAKE_BUDGET,
        search_time_median=float(np.median(times)),
        search_time_p95=float(np.percentile(times, 95)),
    )


def rrt_baseline(cell: Cell, targets: list[FlatteningTarget]) -> RrtFigures:
    """Run OMPL's RRT-Connect between the seven poses (and home), each leg a polyline timed with a stop
    at every corner.

    The poses' configurations come from the own search, since RRT-Connect has none; what it does not
    do is follow the lines that keep the blades flat on the table and the cloth between the hands.
    How far it strays is reported.
    """
    try:
        from ompl import util
    except ImportError:
        return RrtFigures(tasks=0, skipped="needs the extra 'bench' (ompl)")
    util.setLogLevel(util.LogLevel.LOG_ERROR)
    util.RNG.setSeed(1)
    settings, kinematics = PlannerSettings(), Kinematics(cell)
    contact = CollisionModel(cell, contact=True)
    search = MotionSearch(cell, settings, kinematics, contact)
    home = np.array(cell.robot.named_states["home"], dtype=float)
    times, motions, strays, stretches, solved = [], [], [], [], 0
    for target in targets:
        motion, _ = search.dual(target)
        if motion is None:
            continue
        clock = time.perf_counter()
        legs = _legs(cell, contact, [home, *_pose_configurations(motion), home])
        times.append(time.perf_counter() - clock)
        if legs is None:
            continue
        solved += 1
        motions.append(_duration(cell, legs, settings))
        strays.append(_stray(kinematics, motion, legs))
        tips = kinematics.tcp_positions(_densified(np.concatenate(legs[3:5])))
        distance = np.linalg.norm(tips[:, 0] - tips[:, 1], axis=1).max()
        stretches.append(float(distance) / target.geodesic_distance)

    def median(values: list[float]) -> float | None:
        return float(np.median(values)) if values else None

    return RrtFigures(
        tasks=len(targets),
        dual_arm_success=solved / len(targets),
        planning_time_median=median(times),
        planning_time_max=max(times, default=None),
        motion_time_median=median(motions),
        deviation_median=median(strays),
        deviation_max=max(strays, default=None),
        stretch_max=max(stretches, default=None),
    )


def _pose_configurations(motion: SevenPoseMotion) -> list[Array]:
    a, p, r = motion.paths
    i, j, k = motion.corner_index
    poses = [a[0], a[i], a[-1], p[j], p[-1], r[k], r[-1]]
    assert len(poses) == len(POSES)
    return poses


def _legs(cell: Cell, contact: CollisionModel, stops: list[Array]) -> list[Array] | None:
    """Polylines between consecutive stops, or None as soon as one leg fails."""
    from ompl import base, geometric

    space = base.RealVectorStateSpace(len(stops[0]))
    bounds = base.RealVectorBounds(len(stops[0]))
    for i, (low, high) in enumerate(zip(cell.limits.lower, cell.limits.upper, strict=True)):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space.setBounds(bounds)

    def configuration(state: Any) -> Array:
        return np.array([state[i] for i in range(len(stops[0]))])

    def state(q: Array) -> Any:
        out = space.allocState()
        for i, value in enumerate(q):
            out[i] = float(value)
        return out

    legs = []
    for start, goal in pairwise(stops):
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda s: contact.free(configuration(s)))
        setup.getSpaceInformation().setStateValidityCheckingResolution(_RESOLUTION)
        setup.setStartAndGoalStates(state(start), state(goal))
        setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
        if not setup.solve(_RRT_BUDGET) or not setup.haveExactSolutionPath():
            return None
        setup.simplifySolution(0.5)
        path = setup.getSolutionPath()
        legs.append(np.array([configuration(s) for s in path.getStates()]))
    return legs


def _duration(cell: Cell, legs: list[Array], settings: PlannerSettings) -> float:
    total = 0.0
    for leg in legs:
        for a, b in pairwise(leg):
            total += time_line(a, b, cell.limits, settings.margin, settings.sample_time)[3]
    return total


def _densified(path: Array) -> Array:
    parts = [np.linspace(a, b, 20) for a, b in pairwise(path)]
    return np.concatenate(parts)


def _stray(kinematics: Kinematics, motion: SevenPoseMotion, legs: list[Array]) -> float:
    """Greatest distance of a tool centre point from the planned Cartesian path between the plan and
    leave poses, m.
    """
    planned = kinematics.tcp_positions(np.concatenate(motion.paths))
    taken = kinematics.tcp_positions(_densified(np.concatenate(legs[1:-1])))
    gaps = np.linalg.norm(taken[:, None] - planned[None], axis=-1)  # (N, M, 2)
    return float(gaps.min(axis=1).max())
