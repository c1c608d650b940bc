"""Search for a dual-arm flattening motion: turn-table, tilts, offsets and hands, best first (Algorithm 1, corrected).

Differences from the paper's Algorithm 1: both signs of the offsets, their sum as the cost instead of their product, best
first with early exit instead of the full grid, further freedoms (turn-table, tilt per hand, hand assignment, shorter strokes,
unequal shares), and an explicit answer when there is nothing.
"""

import itertools
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.collision import CollisionModel
from unwrinkle.planning.kinematics import Array, Kinematics
from unwrinkle.planning.poses import (
    PIECES,
    Freedom,
    approach_direction,
    piece_counts,
    pieces,
    seven_positions,
    tool_poses,
    tool_rotation,
)
from unwrinkle.planning.settings import MotionShape, PlannerSettings, Stage

_JUMP = 0.35  # rad between neighbouring points of a path, beyond which a branch is not followed
_BATCH = 48  # hand candidates whose key poses are solved in one call
_TUBES = 2  # best branches of each hand that are tried together


@dataclass(frozen=True)
class HandCandidate:
    """One hand of the target served by one arm with one choice of the freedoms."""

    side: int
    arm: int
    turntable: float
    freedom: Freedom


@dataclass(frozen=True, eq=False)
class Motion:
    """A collision-free motion through the seven poses.

    Attributes:
        paths: three pieces (approach, pull, release), each (N, 13) configurations in rad.
        hands: for arm 0 and arm 1, what it does; None for an arm that stays at home.
        corner_index: for each piece, the index of the configuration nearest to its middle pose.
        shape: distances of the seven poses.
        cost: of the choice, see `CostWeights`.
    """

    paths: tuple[Array, ...]
    corner_index: tuple[int, ...]
    hands: tuple[HandCandidate | None, HandCandidate | None]
    shape: MotionShape
    cost: float


@dataclass
class SearchLog:
    """What the search met, for the reason when it fails."""

    pairs: int = 0
    candidates: int = 0
    beyond_reach: int = 0
    missing: float = np.inf
    missing_hand: HandCandidate | None = None
    near_limit: int = 0
    limit_axes: dict[str, int] | None = None
    in_collision: int = 0
    colliding: tuple[str, str] | None = None
    time_inverse: float = 0.0
    out_of_time: bool = False


class MotionSearch:
    """Searches motions for targets in one cell."""

    def __init__(
        self, cell: Cell, settings: PlannerSettings, kinematics: Kinematics, contact: CollisionModel
    ) -> None:
        """Use the given models.

        Args:
            cell: robot and limits; its gripper's tilt window bounds the tilts.
            settings: freedoms and budgets.
            kinematics: of the cell.
            contact: collision model in which the fingers may touch the table.
        """
        self._cell, self._settings = cell, settings
        self._kinematics, self._collision = kinematics, contact
        gripper = cell.scenario.gripper
        self._window = (gripper.tilt_lower - 1e-9, gripper.tilt_upper + 1e-9)
        self._home = np.array(cell.robot.named_states["home"])

    def dual(self, target: FlatteningTarget) -> tuple[Motion | None, SearchLog]:
        """The cheapest free dual-arm motion found, or None with the log of what was met."""
        log, deadline = SearchLog(), time.perf_counter() + self._settings.budget
        for stage in self._settings.stages:
            motion = _StageSearch(self, target, stage, log, deadline).dual()
            if motion is not None or log.out_of_time:
                return motion, log
        return None, log

    def single(self, target: FlatteningTarget) -> tuple[Motion | None, SearchLog]:
        """The cheapest free motion of one arm on one side of the target, the other arm at home."""
        log, deadline = SearchLog(), time.perf_counter() + self._settings.budget
        for stage in self._settings.stages:
            motion = _StageSearch(self, target, stage, log, deadline).single()
            if motion is not None or log.out_of_time:
                return motion, log
        return None, log


class _StageSearch:
    """One stage of a search; caches what it solves."""

    def __init__(
        self,
        parent: MotionSearch,
        target: FlatteningTarget,
        stage: Stage,
        log: SearchLog,
        deadline: float,
    ) -> None:
        self._cell, self._settings = parent._cell, parent._settings
        self._kinematics, self._collision = parent._kinematics, parent._collision
        self._home, self._target, self._stage, self._log = parent._home, target, stage, log
        self._deadline = deadline
        low, high = parent._window
        self._tilts = [tilt for tilt in stage.tilts if low <= tilt <= high]
        self._natural = natural_assignment(target)
        self._reachable: dict[HandCandidate, bool] = {}
        self._tubes: dict[tuple[HandCandidate, tuple[int, ...]], list[list[Array]]] = {}

    # ------------------------------------------------------------------ pairs and singles

    def dual(self) -> Motion | None:
        hands = {
            (side, arm): self._within_reach(side, arm)
            for side, arm in itertools.product((0, 1), repeat=2)
            if self._stage.swap or self._natural[side] == arm
        }
        pairs: list[tuple[float, HandCandidate, HandCandidate]] = []
        for side in (0, 1):  # the side that arm 0 serves
            if (side, 0) not in hands:
                continue
            swapped = self._natural[side] != 0
            by_turn: dict[tuple[float, float], list[HandCandidate]] = {}
            for candidate in hands[1 - side, 1]:
                key = (candidate.turntable, candidate.freedom.share)
                by_turn.setdefault(key, []).append(candidate)
            for a in hands[side, 0]:
                partner = 2.0 - a.freedom.share
                for b in by_turn.get((a.turntable, partner), []):
                    pairs.append((self._cost(a) + self._cost(b) + self._shared(a, swapped), a, b))
        pairs.sort(key=lambda pair: pair[0])
        for i, (cost, a, b) in enumerate(pairs):
            if self._late():
                return None
            if not (self._solvable(a, pairs, i) and self._solvable(b, pairs, i)):
                continue
            counts = self._counts(a, b)
            for qa, qb in itertools.product(self._tube(a, counts), self._tube(b, counts)):
                self._log.pairs += 1
                paths = [self._join(a.turntable, x, y) for x, y in zip(qa, qb, strict=True)]
                if self._paths_free(paths):
                    return self._motion(paths, (a, b), cost)
        return None

    def single(self) -> Motion | None:
        pool = [c for side in (0, 1) for arm in (0, 1) for c in self._within_reach(side, arm)]
        ranked = sorted(
            (
                self._cost(c) + self._shared(c, self._natural[c.side] != c.arm),
                i,
                c,
            )
            for i, c in enumerate(pool)
            if c.freedom.share == 1.0
        )
        pairs = [(cost, c, c) for cost, _, c in ranked]
        for i, (cost, c, _) in enumerate(pairs):
            if self._late():
                return None
            if not self._solvable(c, pairs, i):
                continue
            counts = self._counts(c, c)
            for q in self._tube(c, counts):
                rest = [np.repeat(self._home[None, 1:7], len(x), axis=0) for x in q]
                ordered = (q, rest) if c.arm == 0 else (rest, q)
                paths = [self._join(c.turntable, x, y) for x, y in zip(*ordered, strict=True)]
                if self._paths_free(paths):
                    hands = (c, None) if c.arm == 0 else (None, c)
                    return self._motion(paths, hands, cost)
        return None

    # ------------------------------------------------------------------ candidates

    def _within_reach(self, side: int, arm: int) -> list[HandCandidate]:
        """Candidates of a hand whose seven poses are no further away than the arm is long."""
        hand = self._target.hands[side]
        turns = np.array(self._stage.turntable)
        shares = sorted({share[side] for share in self._stage.shares})
        out = []
        for share in shares:
            freedoms = [
                Freedom(o, t, share) for o in self._stage.offsets for t in self._tilts
            ]
            X = np.stack([self._poses(hand_freedom, hand) for hand_freedom in freedoms])
            missing = self._kinematics.missing_reach(arm, turns[:, None, None], X[None]).max(-1)
            self._log.candidates += missing.size
            self._log.beyond_reach += int((missing > 0.0).sum())
            for i, j in zip(*np.nonzero(missing <= 0.0), strict=True):
                out.append(HandCandidate(side, arm, float(turns[i]), freedoms[j]))
            i, j = np.unravel_index(int(np.argmin(missing)), missing.shape)
            if arm == self._natural[side] and not np.any(missing <= 0.0):
                if missing[i, j] < self._log.missing:
                    self._log.missing = float(missing[i, j])
                    self._log.missing_hand = HandCandidate(
                        side, arm, float(turns[i]), freedoms[j]
                    )
        return out

    def _poses(self, freedom: Freedom, hand) -> Array:  # type: ignore[no-untyped-def]
        rotation = tool_rotation(approach_direction(hand, freedom.offset), freedom.tilt)
        return tool_poses(seven_positions(hand, freedom, self._stage.shape), rotation)

    def _cost(self, c: HandCandidate) -> float:
        w = self._settings.weights
        return (
            w.offset * abs(c.freedom.offset)
            + w.tilt * abs(c.freedom.tilt - w.preferred_tilt)
            + 0.5 * w.share * abs(c.freedom.share - 1.0)
        )

    def _shared(self, c: HandCandidate, swapped: bool) -> float:
        w = self._settings.weights
        return w.turntable * abs(c.turntable) + w.swap * swapped

    def _solvable(self, candidate: HandCandidate, pairs, i: int) -> bool:  # type: ignore[no-untyped-def]
        """Whether all seven poses have a branch within limits; solves the next candidates' too."""
        if candidate not in self._reachable:
            start = time.perf_counter()
            batch: dict[HandCandidate, None] = {}
            for _, a, b in itertools.islice(pairs, i, None):
                for c in (a, b):
                    if c not in self._reachable and c.arm == candidate.arm:
                        batch.setdefault(c)
                if len(batch) >= _BATCH:
                    break
            todo = list(batch)
            X = np.stack([self._poses(c.freedom, self._target.hands[c.side]) for c in todo])
            turns = np.repeat([c.turntable for c in todo], 7)
            solution = self._kinematics.inverse(
                candidate.arm, turns, X.reshape(-1, 4, 4), iterations=5, tolerance=1e-6
            )
            within = solution.within.any(-1).reshape(-1, 7).all(-1)
            for c, ok in zip(todo, within, strict=True):
                self._reachable[c] = bool(ok)
            if not within.all():
                found = solution.found.any(-1).reshape(-1, 7).all(-1)
                self._log.near_limit += int((found & ~within).sum())
                self._count_limits(solution, found & ~within)
            self._log.time_inverse += time.perf_counter() - start
        return self._reachable[candidate]

    def _count_limits(self, solution, blocked: NDArray[np.bool_]) -> None:  # type: ignore[no-untyped-def]
        """Count which axes' limits the otherwise solved poses break, at the least broken branch."""
        rows = np.flatnonzero(np.repeat(blocked, 7) & ~solution.within.any(-1))
        if len(rows) == 0:
            return
        q, found = solution.q[rows], solution.found[rows]
        lower, upper = self._kinematics.lower, self._kinematics.upper
        excess = np.maximum(lower - q, q - upper)
        worst = np.where(found, excess.max(-1), np.inf).argmin(-1)
        chosen = excess[np.arange(len(rows)), worst]
        axes = self._log.limit_axes or {}
        for row in chosen:
            name = "SLURBT"[int(row.argmax())]
            axes[name] = axes.get(name, 0) + 1
        self._log.limit_axes = axes

    # ------------------------------------------------------------------ tubes

    def _counts(self, a: HandCandidate, b: HandCandidate) -> list[int]:
        shape = self._stage.shape
        pair = tuple(seven_positions(self._target.hands[c.side], c.freedom, shape) for c in (a, b))
        return piece_counts((pair[0], pair[1]), self._settings.path_step)

    def _tube(self, c: HandCandidate, counts: list[int]) -> list[list[Array]]:
        """Branches of the arm along the three pieces, best joint-limit margin first."""
        key = (c, tuple(counts))
        if key in self._tubes:
            return self._tubes[key]
        start = time.perf_counter()
        hand = self._target.hands[c.side]
        positions = seven_positions(hand, c.freedom, self._stage.shape)
        parts = pieces(positions, self._stage.shape.blend, counts)
        rotation = tool_rotation(approach_direction(hand, c.freedom.offset), c.freedom.tilt)
        X = tool_poses(np.concatenate(parts), rotation)
        solution = self._kinematics.inverse(c.arm, c.turntable, X)
        lower, upper = self._kinematics.lower, self._kinematics.upper
        tubes = follow_branches(solution.q, solution.within, lower, upper)
        margins = [min(0.5, float(np.min(np.minimum(q - lower, upper - q)[:, :5]))) for q in tubes]
        cuts = np.cumsum([len(part) for part in parts])[:-1]
        best = np.argsort(margins)[::-1][:_TUBES]
        self._tubes[key] = [np.split(tubes[i], cuts) for i in best]
        self._log.time_inverse += time.perf_counter() - start
        return self._tubes[key]

    def _motion(
        self,
        paths: list[Array],
        hands: tuple[HandCandidate | None, HandCandidate | None],
        cost: float,
    ) -> Motion:
        served = next(c for c in hands if c is not None)
        positions = seven_positions(
            self._target.hands[served.side], served.freedom, self._stage.shape
        )
        corners = []
        for (_, first, _), path in zip(PIECES, paths, strict=True):
            legs = np.linalg.norm(np.diff(positions[first : first + 3], axis=0), axis=1)
            corners.append(round(float(legs[0] / max(legs.sum(), 1e-12)) * (len(path) - 1)))
        return Motion(tuple(paths), tuple(corners), hands, self._stage.shape, cost)

    def _join(self, turntable: float, right: Array, left: Array) -> Array:
        return np.column_stack([np.full(len(right), turntable), right, left])

    def _paths_free(self, paths: list[Array]) -> bool:
        ends = [paths[0][0], paths[0][-1], paths[1][-1], paths[2][-1]]
        for q in ends:
            if not self._collision.free(q):
                self._log.in_collision += 1
                self._log.colliding = self._collision.colliding_pair(q)
                return False
        if not all(self._collision.path_free(path) for path in paths):
            self._log.in_collision += 1
            return False
        return True

    def _late(self) -> bool:
        self._log.out_of_time = time.perf_counter() > self._deadline
        return self._log.out_of_time


def natural_assignment(target: FlatteningTarget) -> tuple[int, int]:
    """Which arm serves hand 0 and hand 1: the right arm the one further to the right (lesser world x)."""
    x = [hand.p_WG[0] for hand in target.hands]
    return (0, 1) if x[0] <= x[1] else (1, 0)


def follow_branches(
    q: Array, within: NDArray[np.bool_], lower: Array, upper: Array
) -> list[Array]:
    """Continuous sequences of branches along a path.

    Args:
        q: (N, 8, 6) branches of each point, rad.
        within: (N, 8) usable.
        lower: (6,) position limits, rad.
        upper: (6,)

    Returns:
        Sequences (N, 6) without a jump; the last axis may turn by full turns, so its representative is chosen to stay within.
    """
    tubes: list[Array] = []
    for b in np.flatnonzero(within[0]):
        current = q[0, b]
        sequence = [current]
        for j in range(1, len(q)):
            step = q[j] - current
            step[:, 5] = (step[:, 5] + np.pi) % (2.0 * np.pi) - np.pi
            distance = np.where(within[j], np.abs(step).max(axis=1), np.inf)
            k = int(distance.argmin())
            if distance[k] > _JUMP:
                break
            current = current + step[k]
            sequence.append(current)
        if len(sequence) < len(q):
            continue
        path = np.array(sequence)
        for turn in (0.0, 2.0 * np.pi, -2.0 * np.pi):
            last = path[:, 5] + turn
            if last.min() >= lower[5] and last.max() <= upper[5]:
                path[:, 5] = last
                tubes.append(path)
                break
    return tubes
