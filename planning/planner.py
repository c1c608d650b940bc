"""From a flattening target to a plan: search, transits, timing, samples."""

import logging
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError, NoSafePlanError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.assembly import MotionTiming
from unwrinkle.planning.collision import CollisionModel
from unwrinkle.planning.failure import PlanFailure, explain
from unwrinkle.planning.hand_paths import HandCandidate
from unwrinkle.planning.kinematics import Kinematics
from unwrinkle.planning.plan import (
    ArmChoice,
    FlatteningPlan,
    GarmentSurface,
)
from unwrinkle.planning.search import Motion, MotionSearch
from unwrinkle.planning.settings import PlannerSettings
from unwrinkle.planning.time_law import TimedPath
from unwrinkle.planning.transit import Transit, TransitPlanner

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)
_ARMS = {"any": ("dual", "single"), "dual": ("dual",), "single": ("single",)}


@dataclass
class Timings:
    """How long each stage of planning took, s, and how the transits were found."""

    search: float = 0.0
    transit: float = 0.0
    timing: float = 0.0
    transit_kinds: tuple[str, ...] = ()

    @property
    def total(self) -> float:
        """All stages, s."""
        return self.search + self.transit + self.timing


@dataclass(frozen=True, eq=False)
class PlanResult:
    """What planning gave.

    Attributes:
        plan: the plan, or None.
        failure: why there is no plan, or why it is a single-arm one; None for a dual-arm plan.
        timings: of the stages.
        pieces: the three timed pieces between the gripper events and the plan and leave poses.
        transits: from the start, and to home.
    """

    plan: FlatteningPlan | None
    failure: PlanFailure | None
    timings: Timings
    pieces: tuple[TimedPath, ...] = ()
    transits: tuple[Transit, ...] = ()


class FlatteningPlanner:
    """Plans flattening motions in one cell; building it takes under a second, each plan some tenths."""

    def __init__(self, cell: Cell, settings: PlannerSettings | None = None) -> None:
        """Build the models of the cell once."""
        self._cell = cell
        self._settings = PlannerSettings() if settings is None else settings
        kinematics = Kinematics(cell)
        contact = CollisionModel(cell, contact=True)
        self._search = MotionSearch(cell, self._settings, kinematics, contact)
        self._timing = MotionTiming(cell, self._settings, kinematics)
        self._free = CollisionModel(cell, contact=False)
        self._transits = TransitPlanner(
            cell.limits,
            self._free,
            self._settings.transit_budget,
            self._settings.seed,
        )
        self._home = np.array(cell.robot.named_states["home"], dtype=float)

    def plan(
        self,
        target: FlatteningTarget,
        *,
        start: Array | None = None,
        garment: GarmentSurface | None = None,
        arms: str = "any",
    ) -> PlanResult:
        """Plan the motion for a target, from a configuration at rest and to home.

        Args:
            target: grasp points, directions and pull distances in the world.
            start: (13,) rad, at rest; home if left out.
            garment: stored in the plan for the preview.
            arms: `dual`, `single`, or `any`: two arms if possible, else one.

        Returns:
            A plan, or the reason why there is none; never an exception for a target out of reach.

        Raises:
            InputError: the start is no configuration, or `arms` is none of the three.
        """
        timings = Timings()
        start = self._home if start is None else np.asarray(start, dtype=float)
        if start.shape != self._home.shape or not np.all(np.isfinite(start)):
            raise InputError(f"start must be {len(self._home)} finite angles, got {start!r}")
        if arms not in _ARMS:
            raise InputError(f"arms must be one of {', '.join(_ARMS)}, got {arms!r}")
        blocked = self._blocked(start)
        if blocked is not None:
            return PlanResult(None, blocked, timings)
        failure = None
        for kind in _ARMS[arms]:
            ways = _Ways(self._transits, start, self._home)
            clock = time.perf_counter()
            search = self._search.dual if kind == "dual" else self._search.single
            motion, log = search(target, ways.exist)
            timings.search += time.perf_counter() - clock - ways.duration
            timings.transit += ways.duration
            if motion is None or ways.found is None:
                failure = failure or explain(kind, log, target)
                continue
            clock = time.perf_counter()
            try:
                pieces = self._timing.pieces(motion)
                segments, events = self._timing.segments(motion, pieces, ways.found)
            except NoSafePlanError as error:
                failure = failure or PlanFailure("time", f"no {kind}-arm motion: {error}")
                continue
            timings.timing = time.perf_counter() - clock
            timings.transit_kinds = tuple(way.kind for way in ways.found)
            _log.info(
                "planned arms=%s search=%.3f transit=%.3f timing=%.3f",
                kind,
                timings.search,
                timings.transit,
                timings.timing,
            )
            plan = FlatteningPlan(
                robot=self._cell.robot.name,
                robot_hash=self._cell.robot_hash,
                limits_hash=self._cell.limits_hash,
                speed=self._cell.scenario.speed,
                target=target,
                arms=(_choice(motion.hands[0]), _choice(motion.hands[1])),
                turntable=float(motion.paths[0][0, 0]),
                segments=segments,
                events=events,
                note="" if failure is None else failure.message,
                garment=garment,
            )
            return PlanResult(plan, failure, timings, tuple(pieces), ways.found)
        return PlanResult(None, failure, timings)

    def _blocked(self, start: Array) -> PlanFailure | None:
        """Why the motion cannot start where it should; None if it can."""
        limits = self._cell.limits
        outside = np.flatnonzero((start < limits.lower) | (start > limits.upper))
        if len(outside):
            axis = self._cell.robot.axes[outside[0]]
            return PlanFailure(
                "start",
                f"the start has {axis} at {start[outside[0]]:.3f} rad, outside its limits; "
                "jog the robot back first",
            )
        if not self._free.free(start):
            pair = self._free.colliding_pair(start) or ("two bodies", "each other")
            return PlanFailure(
                "start",
                f"at the start {pair[0]} is too close to {pair[1]}; jog the robot away first",
            )
        return None


class _Ways:
    """Looks for the ways from the start to a motion and from there home.

    Attributes:
        found: the ways of the last motion that has them.
        duration: time spent, s.
    """

    def __init__(self, transits: TransitPlanner, start: Array, home: Array) -> None:
        self._transits, self._start, self._home = transits, start, home
        self.found: tuple[Transit, Transit] | None = None
        self.duration = 0.0

    def exist(self, motion: Motion) -> bool:
        clock = time.perf_counter()
        there = self._transits.plan(self._start, motion.paths[0][0])
        if there is not None:
            back = self._transits.plan(motion.paths[-1][-1], self._home)
            self.found = None if back is None else (there, back)
        self.duration += time.perf_counter() - clock
        return there is not None and self.found is not None


def _choice(hand: HandCandidate | None) -> ArmChoice | None:
    if hand is None:
        return None
    freedom = hand.freedom
    return ArmChoice(hand.side, freedom.offset, freedom.tilt, freedom.share)
