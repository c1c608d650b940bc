"""From a flattening target to a plan: search, transits, timing, samples."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError, NoVerifiedPlanError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import (
    ArmChoice,
    FlatteningPlan,
    GarmentSurface,
)
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.assembly import MotionTiming
from unwrinkle.planning.search.failure import PlanFailure, explain, off_table
from unwrinkle.planning.search.hand_paths import HandCandidate
from unwrinkle.planning.search.motion_search import MotionSearch, SevenPoseMotion
from unwrinkle.planning.search.settings import PlannerSettings, with_turntable_at
from unwrinkle.planning.search.transit import Transit, TransitPlanner
from unwrinkle.planning.timing.joint_path import TimedPath

_log = logging.getLogger(__name__)
_ARMS = {"any": ("dual", "single"), "dual": ("dual",), "single": ("single",)}


@dataclass
class Timings:
    """How long each stage of planning took, s, and how the transits were found.

    `approval` is the time of whoever was asked about each plan, and no part of the planning.
    """

    search: float = 0.0
    transit: float = 0.0
    timing: float = 0.0
    approval: float = 0.0
    transit_kinds: tuple[str, ...] = ()

    @property
    def total(self) -> float:
        """All stages of the planning, s."""
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


#: Asked about a plan: why it must not be used; empty if it may.
Approve = Callable[[FlatteningPlan], str]


class FlatteningPlanner:
    """Plans flattening motions in one cell.

    Building it takes under a second, each plan some tenths.
    """

    def __init__(self, cell: Cell, settings: PlannerSettings | None = None) -> None:
        """Build the models of the cell once."""
        self._cell = cell
        self._settings = PlannerSettings() if settings is None else settings
        self._kinematics = Kinematics(cell)
        self._contact = CollisionModel(cell, contact=True)
        self._timing = MotionTiming(cell, self._settings, self._kinematics)
        self._free = self._contact.with_contact(False)
        self._fixed = cell.scenario.planner.turntable == "fixed"
        self._transits = TransitPlanner(
            cell,
            self._free,
            self._settings.transit_budget,
            self._settings.seed,
            fixed_turntable=self._fixed,
            settings=self._settings.transit,
        )
        self._home = np.array(cell.robot.named_states["home"], dtype=float)

    def plan(
        self,
        target: FlatteningTarget,
        *,
        start: Array | None = None,
        garment: GarmentSurface | None = None,
        arms: str = "any",
        approve: Approve | None = None,
    ) -> PlanResult:
        """Plan the motion for a target, from a configuration at rest and to home.

        Where the scenario's planner keeps the turn-table fixed, it stays where the start has it, at
        home too.

        Args:
            target: grasp points, directions and pull distances in the world.
            start: (13,) rad, at rest; home if left out.
            garment: stored in the plan for the preview.
            arms: `dual`, `single`, or `any`: two arms if possible, else one.
            approve: asked about each plan; where it refuses, the next motion is tried. See
                `plan_verified`.

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
        blocked = self._blocked(start) or off_table(target, self._cell)
        if blocked is not None:
            return PlanResult(None, blocked, timings)
        search = self._search(start)
        failure = None
        for kind in _ARMS[arms]:
            attempt = _Attempt(self, target, start, garment, failure, approve)
            clock = time.perf_counter()
            look = search.dual if kind == "dual" else search.single
            _, log = look(target, attempt.accept)
            spent = time.perf_counter() - clock
            timings.search += spent - attempt.times.total - attempt.times.approval
            timings.transit += attempt.times.transit
            timings.timing += attempt.times.timing
            timings.approval += attempt.times.approval
            if attempt.result is None:
                failure = failure or attempt.failure(kind) or explain(kind, log, target, self._cell)
                continue
            timings.transit_kinds = tuple(way.kind for way in attempt.result.transits)
            _log.info(
                "planned arms=%s search=%.3f transit=%.3f timing=%.3f",
                kind,
                timings.search,
                timings.transit,
                timings.timing,
            )
            return replace(attempt.result, failure=failure, timings=timings)
        return PlanResult(None, failure, timings)

    def _search(self, start: Array) -> MotionSearch:
        settings = self._settings
        if self._fixed:
            settings = with_turntable_at(settings, float(start[0]))
        return MotionSearch(self._cell, settings, self._kinematics, self._contact)

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

    @property
    def most_refusals(self) -> int:
        """Plans of one kind that may be refused before it is given up."""
        return self._settings.refusals

    def home_from(self, start: Array) -> Array:
        """Where a plan from a start (13,) ends, (13,) rad.

        Home, but for a turn-table that is fixed.
        """
        home = self._home.copy()
        if self._fixed:
            home[0] = start[0]
        return home

    def ways(self, start: Array, motion: SevenPoseMotion) -> tuple[Transit, Transit] | None:
        """The ways from a start to a motion and from there home; None where there is none."""
        there = self._transits.plan(start, motion.paths[0][0])
        if there is None:
            return None
        back = self._transits.plan(motion.paths[-1][-1], self.home_from(start))
        return None if back is None else (there, back)

    def timed(
        self,
        motion: SevenPoseMotion,
        ways: tuple[Transit, Transit],
        target: FlatteningTarget,
        garment: GarmentSurface | None,
        note: str,
    ) -> PlanResult:
        """The motion with its ways as a plan.

        Raises:
            NoVerifiedPlanError: a part of it takes longer than the settings allow.
        """
        pieces = self._timing.pieces(motion)
        segments, events = self._timing.segments(motion, pieces, ways)
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
            note=note,
            garment=garment,
        )
        return PlanResult(plan, None, Timings(), tuple(pieces), ways)


class _Attempt:
    """Makes a plan of each free motion of a search in turn, until one is accepted.

    Attributes:
        result: the plan that was accepted.
        times: spent on transits, timing and approval, s.
    """

    def __init__(
        self,
        planner: FlatteningPlanner,
        target: FlatteningTarget,
        start: Array,
        garment: GarmentSurface | None,
        before: PlanFailure | None,
        approve: Approve | None,
    ) -> None:
        self._planner, self._target, self._start = planner, target, start
        self._garment, self._approve = garment, approve
        self._note = "" if before is None else before.message
        self._refusals: list[str] = []
        self._error: NoVerifiedPlanError | None = None
        self.times = Timings()
        self.result: PlanResult | None = None

    def accept(self, motion: SevenPoseMotion) -> bool:
        """Whether the search is over.

        The motion will do, no motion can be timed, or too many plans were refused.
        """
        clock = time.perf_counter()
        ways = self._planner.ways(self._start, motion)
        self.times.transit += time.perf_counter() - clock
        if ways is None:
            return False
        clock = time.perf_counter()
        try:
            made = self._planner.timed(motion, ways, self._target, self._garment, self._note)
        except NoVerifiedPlanError as error:
            self._error = error
            return True
        finally:
            self.times.timing += time.perf_counter() - clock
        if self._approve is not None and made.plan is not None:
            clock = time.perf_counter()
            refusal = self._approve(made.plan)
            self.times.approval += time.perf_counter() - clock
            if refusal:
                _log.info("plan refused: %s", refusal)
                self._refusals.append(refusal)
                return len(self._refusals) >= self._planner.most_refusals
        self.result = made
        return True

    def failure(self, kind: str) -> PlanFailure | None:
        """Why there is no plan, where motions were found."""
        if self._error is not None:
            return PlanFailure("time", f"no {kind}-arm motion: {self._error}")
        if self._refusals:
            return PlanFailure(
                "verification",
                f"no {kind}-arm motion: {len(self._refusals)} plans did not pass the verification; "
                f"the first: {self._refusals[0]}",
            )
        return None


def _choice(hand: HandCandidate | None) -> ArmChoice | None:
    if hand is None:
        return None
    freedom = hand.freedom
    return ArmChoice(hand.side, freedom.offset, freedom.tilt, freedom.share)
