"""One trial of the benchmark `trajectories`: every method on one path, and how near ours comes to the optimum."""

import dataclasses as dc
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.planning.trajectories.measures import judge
from benchmarks.planning.trajectories.methods import METHODS, Problem
from benchmarks.planning.trajectories.optimum import PathProgramme, joint_bound
from benchmarks.planning.trajectories.paths import (
    LINES,
    NAMES,
    PathSet,
    Piece,
    SevenPosePath,
    load_paths,
)
from benchmarks.planning.trajectories.results import Judgement, PieceOptimum, TimedPath
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import Limits
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.testing.toppra_bound import jerk_free_line_time, jerk_free_time

#: Fraction of every limit that every method leaves unused.
MARGIN = PlannerSettings().margin

_INTERVALS = 120  # of the programme that ours is compared with


def timed(settings: dict[str, Any], folder: Path) -> TimedPath:
    """Time and judge one path.

    Args:
        settings: `path`, its name; `set`, the hash of the set; `starts`, how many starts the
            programme gets: 1 (ours) or 2 (also the fifth-order polynomial in time).
        folder: not used.

    Raises:
        InputError: the set is another one, or has no such path.
    """
    paths = load_paths()
    if paths.header["sha256"] != settings["set"]:
        raise InputError(f"the set of paths is not the one with hash {settings['set'][:12]}")
    path = find(paths, settings["path"])
    kinematics = Kinematics(load_cell())
    problem = problem_of(path, paths.limits)
    assert problem.paths  # the curves are built before the clock runs; toppra's laws are not
    methods: dict[str, Judgement] = {}
    for key, (_, method) in METHODS.items():
        clock = time.process_time()
        result = method(problem)
        computing = time.process_time() - clock
        row = judge(path.pieces, result, paths.limits, kinematics)
        methods[key] = dc.replace(row, computing=computing)
    optimum = tuple(_optimum(piece, paths.limits, settings["starts"]) for piece in path.pieces)
    return TimedPath(
        path=path.name,
        group=path.group,
        jerk_free=sum(piece.jerk_free for piece in optimum),
        methods=methods,
        optimum=optimum,
    )


def find(paths: PathSet, name: str) -> SevenPosePath:
    """The path of that name.

    Raises:
        InputError: there is none.
    """
    for path in paths.paths:
        if path.name == name:
            return path
    raise InputError(f"the set has no path {name!r}; it has {paths.paths[0].name} and others")


def problem_of(path: SevenPosePath, limits: Limits) -> Problem:
    """A path under limits less the margin."""
    keep = 1.0 - MARGIN
    less = dc.replace(
        limits,
        velocity=keep * limits.velocity,
        acceleration=keep * limits.acceleration,
        jerk=keep * limits.jerk,
        tip_speed_holding=keep * limits.tip_speed_holding,
    )
    return Problem(path.pieces, less)


def _optimum(piece: Piece, limits: Limits, starts: int) -> PieceOptimum:
    """Times of one piece under the full limits, s.

    Without jerk limit, the lower bound, the programme's, and our law's.
    """
    if piece.name in (NAMES[i] for i in LINES):
        exact = time_line(piece.q[0], piece.q[-1], limits, 0.0, 1.0)[3]
        free = jerk_free_line_time(piece.q[0], piece.q[-1], limits)
        return PieceOptimum(
            piece=piece.name,
            jerk_free=free,
            bound=exact,
            refined=exact,
            refined_dense=exact,
            law=exact,
            starts=(),
            programmes=0,
            computing=0.0,
        )
    tip_speed = limits.tip_speed_holding if piece.holding else None
    path = piece.path()
    full = PathLimits(limits.velocity, limits.acceleration, limits.jerk, tip_speed)
    (law,) = time_paths([path], [full])
    theta = np.linspace(0.0, 1.0, _INTERVALS + 1)
    polynomial = theta**3 * (10.0 - 15.0 * theta + 6.0 * theta**2)
    _, q, _ = law.sample(law.duration / _INTERVALS)
    begins = [_parameters(path, q), polynomial][:starts]
    clock = time.process_time()
    programme = PathProgramme(path, full, _INTERVALS)
    found = [programme.solve(begin) for begin in begins]
    computing = time.process_time() - clock
    free = jerk_free_time(path, limits, tip_speed)
    return PieceOptimum(
        piece=piece.name,
        jerk_free=free,
        bound=max(free, joint_bound(piece.q, limits)),
        refined=min(x.duration for x in found),
        refined_dense=min(x.dense for x in found),
        law=law.duration,
        starts=tuple(x.duration for x in found),
        programmes=sum(x.steps for x in found),
        computing=computing,
    )


def _parameters(path: JointPath, q: Array) -> Array:
    """Path parameters (N,) of configurations (N, n) that lie on the path.

    The nearest of many points, then Newton steps.
    """
    grid = np.linspace(0.0, 1.0, 4001)
    s = grid[cKDTree(path.spline(grid)).query(q)[1]]
    for _ in range(4):
        q1 = path.spline(s, nu=1)
        s = np.clip(s - np.sum((path.spline(s) - q) * q1, axis=1) / np.sum(q1**2, axis=1), 0.0, 1.0)
    s[[0, -1]] = 0.0, 1.0
    return np.asarray(s)
