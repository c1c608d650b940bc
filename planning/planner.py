"""From a flattening target to a plan: search, transits, timing, samples."""

import logging
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.collision import CollisionModel
from unwrinkle.planning.failure import PlanFailure, explain
from unwrinkle.planning.hand_paths import HandCandidate
from unwrinkle.planning.joint_lines import time_line
from unwrinkle.planning.kinematics import Kinematics
from unwrinkle.planning.plan import (
    ArmChoice,
    FlatteningPlan,
    GarmentSurface,
    GripperEvent,
    PoseMark,
    Segment,
)
from unwrinkle.planning.poses import PIECES, POSES
from unwrinkle.planning.search import Motion, MotionSearch
from unwrinkle.planning.settings import PlannerSettings
from unwrinkle.planning.time_law import JointPath, PathLimits, TimedPath, time_paths
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.transit import Transit, TransitPlanner

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)
#: Wait after the grippers' stroke: their controller reports "closed" early by about this, s.
_SETTLE = 0.25
_ARMS = {"any": ("dual", "single"), "dual": ("dual",), "single": ("single",)}


@dataclass
class Timings:
    """How long each stage of planning took, s, and what the motion's parts last, s."""

    search: float = 0.0
    transit: float = 0.0
    timing: float = 0.0
    transit_kinds: tuple[str, ...] = ()
    parts: dict[str, float] = field(default_factory=dict)

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
        self._kinematics = Kinematics(cell)
        contact = CollisionModel(cell, contact=True)
        self._search = MotionSearch(cell, self._settings, self._kinematics, contact)
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
            clock = time.perf_counter()
            search = self._search.dual if kind == "dual" else self._search.single
            motion, log = search(target)
            timings.search += time.perf_counter() - clock
            if motion is None:
                failure = failure or explain(kind, log, target)
                continue
            clock = time.perf_counter()
            ways = self._ways(start, motion)
            timings.transit += time.perf_counter() - clock
            if ways is None:
                failure = failure or PlanFailure("transit", _NO_TRANSIT)
                continue
            clock = time.perf_counter()
            plan, timed = self._timed(target, motion, ways, timings, failure, garment)
            timings.timing = time.perf_counter() - clock
            timings.transit_kinds = tuple(way.kind for way in ways)
            _log.info(
                "planned arms=%s search=%.3f transit=%.3f timing=%.3f",
                kind,
                timings.search,
                timings.transit,
                timings.timing,
            )
            return PlanResult(plan, failure, timings, tuple(timed), ways)
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

    def _ways(self, start: Array, motion: Motion) -> tuple[Transit, Transit] | None:
        there = self._transits.plan(start, motion.paths[0][0])
        back = self._transits.plan(motion.paths[-1][-1], self._home)
        return None if there is None or back is None else (there, back)

    def _timed(
        self,
        target: FlatteningTarget,
        motion: Motion,
        ways: tuple[Transit, Transit],
        timings: Timings,
        failure: PlanFailure | None,
        garment: GarmentSurface | None,
    ) -> tuple[FlatteningPlan, list[TimedPath]]:
        limits, settings = self._cell.limits, self._settings
        keep = 1.0 - settings.margin
        paths, bounds = [], []
        for (name, _, _), points in zip(PIECES, motion.paths, strict=True):
            holding = name == "pull"
            tips = self._kinematics.tcp_positions(points) if holding else None
            paths.append(JointPath.through(points, tips))
            bounds.append(
                PathLimits(
                    keep * limits.velocity,
                    keep * limits.acceleration,
                    keep * limits.jerk,
                    keep * limits.tip_speed_holding if holding else None,
                )
            )
        timed = time_paths(paths, bounds)
        period = settings.sample_time
        pieces = [path.sample(period) for path in timed]
        lines = [self._line_samples(way) for way in ways]
        for label, (t, _, _) in zip(("approach", "pull", "release"), pieces, strict=True):
            timings.parts[label] = float(t[-1])
        timings.parts["in"], timings.parts["out"] = (float(line[0][-1]) for line in lines)
        segments = self._segments(motion, pieces, lines)
        return (
            FlatteningPlan(
                robot=self._cell.robot.name,
                robot_hash=self._cell.robot_hash,
                limits_hash=self._cell.limits_hash,
                speed=self._cell.scenario.speed,
                target=target,
                arms=(_choice(motion.hands[0]), _choice(motion.hands[1])),
                turntable=float(motion.paths[0][0, 0]),
                segments=segments[0],
                events=segments[1],
                note="" if failure is None else failure.message,
                garment=garment,
            ),
            timed,
        )

    def _line_samples(self, way: Transit) -> tuple[Array, Array, Array]:
        parts = []
        for a, b in zip(way.points[:-1], way.points[1:], strict=True):
            t, q, v, _ = time_line(
                a, b, self._cell.limits, self._settings.margin, self._settings.sample_time
            )
            parts.append((t, q, v))
        return _concatenate(parts)

    def _segments(
        self,
        motion: Motion,
        pieces: list[tuple[Array, Array, Array]],
        lines: list[tuple[Array, Array, Array]],
    ) -> tuple[tuple[Segment, ...], tuple[GripperEvent, ...]]:
        gripper = self._cell.limits.gripper
        dwell = gripper.stroke / gripper.velocity + _SETTLE
        closed = (motion.hands[0] is not None, motion.hands[1] is not None)
        joined = [
            _concatenate([lines[0], pieces[0]]),
            pieces[1],
            _concatenate([pieces[2], lines[1]]),
        ]
        segments: list[Segment] = []
        events: list[GripperEvent] = []
        clock = 0.0
        for i, (name, first, last) in enumerate(PIECES):
            t, q, v = joined[i]
            begin = float(lines[0][0][-1]) if i == 0 else 0.0
            end = begin + float(pieces[i][0][-1])
            marks = self._marks(motion, i, first, last, pieces[i], begin)
            state = closed if name == "pull" else (False, False)
            segments.append(Segment(name, clock, Trajectory(t, q, v), state, marks, (begin, end)))
            clock += float(t[-1])
            if i < len(PIECES) - 1:
                events.append(GripperEvent(clock, closed if i == 0 else (False, False), dwell))
                clock += dwell
        return tuple(segments), tuple(events)

    def _marks(
        self,
        motion: Motion,
        piece: int,
        first: int,
        last: int,
        samples: tuple[Array, Array, Array],
        begin: float,
    ) -> tuple[PoseMark, ...]:
        """When the piece passes its poses; the middle one where it comes nearest to it."""
        t, q, _ = samples
        knots = motion.paths[piece]
        middle = knots[motion.corner_index[piece]]
        nearest = int(np.linalg.norm(q - middle, axis=1).argmin())
        times = (0.0, float(t[nearest]), float(t[-1]))
        names = POSES[first : last + 1]
        marks = [PoseMark(n, begin + x) for n, x in zip(names, times, strict=True)]
        return tuple(marks if piece == 0 else marks[1:])


_NO_TRANSIT = (
    "no free way between home and the motion was found in the time allowed; "
    "clear the surroundings of the table or allow a longer transit budget"
)


def _choice(hand: HandCandidate | None) -> ArmChoice | None:
    if hand is None:
        return None
    freedom = hand.freedom
    return ArmChoice(hand.side, freedom.offset, freedom.tilt, freedom.share)


def _concatenate(parts: list[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    """Samples one after the other; each part starts where the one before rests."""
    times, positions, velocities = [parts[0][0]], [parts[0][1]], [parts[0][2]]
    for t, q, v in parts[1:]:
        times.append(t[1:] + times[-1][-1])
        positions.append(q[1:])
        velocities.append(v[1:])
    return np.concatenate(times), np.concatenate(positions), np.concatenate(velocities)
