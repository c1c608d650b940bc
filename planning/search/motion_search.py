"""Best-first search for a dual-arm flattening motion over turn-table, tilts, offsets and assignment
of hands.

Based on Algorithm 1 of Sun et al. 2015, with these differences: both signs of the offsets; the sum
of the offsets as the cost instead of their product; best first with early exit instead of the full
grid; further freedoms (turn-table, tilt per hand, assignment of hands, shorter strokes, unequal
shares); a log that explains a failure.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.hand_paths import HandCandidate, HandPaths, SearchLog
from unwrinkle.planning.search.key_poses import PIECES, piece_counts, seven_positions
from unwrinkle.planning.search.settings import MotionShape, PlannerSettings, Stage

Hands = tuple[HandCandidate | None, HandCandidate | None]

#: A pull direction counts as straight ahead if its x is no greater than this.
_STRAIGHT = 1e-3
#: Combinations whose hands may be solved in one batch.
_LOOK_AHEAD = 400


@dataclass(frozen=True, eq=False)
class SevenPoseMotion:
    """A collision-free motion through the seven poses.

    Attributes:
        paths: three pieces (approach, pull, release), each (N, axes) configurations in rad.
        corner_index: for each piece, the index of the configuration nearest to its middle pose.
        hands: candidate served by the right and the left arm; None for an arm that stays at home.
        shape: distances of the seven poses.
        cost: of the freedoms, see `CostWeights`.
    """

    paths: tuple[Array, ...]
    corner_index: tuple[int, ...]
    hands: Hands
    shape: MotionShape
    cost: float


def _any_motion(motion: SevenPoseMotion) -> bool:
    return True


class MotionSearch:
    """Search for motions of targets in one cell."""

    def __init__(
        self,
        cell: Cell,
        settings: PlannerSettings,
        kinematics: Kinematics,
        contact: CollisionModel,
    ) -> None:
        """Use the given models.

        Args:
            cell: robot and limits; its gripper's tilt window bounds the tilts.
            settings: freedoms and budgets.
            kinematics: of the cell.
            contact: collision model in which the fingers may touch the table.
        """
        self._settings, self._kinematics, self._collision = settings, kinematics, contact
        gripper = cell.scenario.gripper
        self._window = (gripper.tilt_lower, gripper.tilt_upper)
        self._arms = cell.robot.arms
        self._home = np.array(cell.robot.named_states["home"], dtype=float)

    def dual(
        self, target: FlatteningTarget, accept: Callable[[SevenPoseMotion], bool] = _any_motion
    ) -> tuple[SevenPoseMotion | None, SearchLog]:
        """Find the cheapest collision-free dual-arm motion that is accepted.

        Args:
            target: grasp points, directions and pull distances.
            accept: called with each free motion in order of cost until it returns true (there are
                transits to it, for example).

        Returns:
            The motion, or None, and the log of the search.
        """
        return self._search(target, self._pairs, accept)

    def single(
        self, target: FlatteningTarget, accept: Callable[[SevenPoseMotion], bool] = _any_motion
    ) -> tuple[SevenPoseMotion | None, SearchLog]:
        """Find the cheapest motion of one arm on one side of the target, with the other arm at
        home.

        The arm is the one that the flattening direction suggests (see `suggested_arm`); the other
        arm is tried only if that one has no motion on either side. Of the two sides the cheaper one
        is taken; of equally cheap ones, hand 0.

        Args:
            target: see `dual`.
            accept: see `dual`.

        Returns:
            See `dual`.
        """
        motion, log = self._search(target, self._suggested, accept)
        if motion is None and not log.out_of_time:
            other, other_log = self._search(target, self._others, accept)
            if other is not None:
                return other, other_log
        return motion, log

    def _search(
        self,
        target: FlatteningTarget,
        combine: Callable[[FlatteningTarget, Stage, HandPaths], list[tuple[float, Hands]]],
        accept: Callable[[SevenPoseMotion], bool],
    ) -> tuple[SevenPoseMotion | None, SearchLog]:
        log, deadline = SearchLog(), time.perf_counter() + self._settings.budget
        for stage in self._settings.stages:
            log.missing, log.missing_hand = np.inf, None
            paths = HandPaths(target, stage, self._window, self._kinematics, log)
            ranked = sorted(combine(target, stage, paths), key=lambda item: item[0])
            serving = [tuple(c for c in hands if c is not None) for _, hands in ranked]
            for i, (cost, hands) in enumerate(ranked):
                if time.perf_counter() > deadline:
                    log.out_of_time = True
                    return None, log
                ahead = serving[i : i + _LOOK_AHEAD]
                if all(paths.solvable(c, ahead) for c in serving[i]):
                    motion = self._first_free(target, stage, paths, hands, cost, log)
                    if motion is not None:
                        if accept(motion):
                            return motion, log
                        log.refused += 1
        return None, log

    def _first_free(
        self,
        target: FlatteningTarget,
        stage: Stage,
        paths: HandPaths,
        hands: Hands,
        cost: float,
        log: SearchLog,
    ) -> SevenPoseMotion | None:
        """Return the first collision-free combination of the hands' branches, or None."""
        serving = [c for c in hands if c is not None]
        positions = [seven_positions(target.hands[c.side], c.freedom, stage.shape) for c in serving]
        counts = piece_counts(positions, self._settings.path_step)
        rest = [[self._resting(arm, counts)] for arm in (0, 1)]
        tubes = [rest[arm] if c is None else paths.tubes(c, counts) for arm, c in enumerate(hands)]
        for right, left in itertools.product(*tubes):
            log.pairs += 1
            joined = [
                self._kinematics.configurations(serving[0].turntable, a, b)
                for a, b in zip(right, left, strict=True)
            ]
            if self._free(joined, log):
                corners = _corner_indices(positions[0], joined)
                return SevenPoseMotion(tuple(joined), corners, hands, stage.shape, cost)
        return None

    def _resting(self, arm: int, counts: list[int]) -> list[Array]:
        q = self._home[self._arms[arm].axes]
        return [np.repeat(q[None], count + 1, axis=0) for count in counts]

    def _free(self, paths: list[Array], log: SearchLog) -> bool:
        for q in (paths[0][0], paths[0][-1], paths[1][-1], paths[2][-1]):
            if not self._collision.free(q):
                log.in_collision += 1
                pair = self._collision.colliding_pair(q)
                log.colliding.update([] if pair is None else [pair])
                return False
        if all(self._collision.path_free(path) for path in paths):
            return True
        log.in_collision += 1
        return False

    # ------------------------------------------------------------------ combinations and their cost

    def _pairs(
        self, target: FlatteningTarget, stage: Stage, paths: HandPaths
    ) -> list[tuple[float, Hands]]:
        natural = natural_assignment(target)
        pairs: list[tuple[float, Hands]] = []
        for side in (0, 1):  # hand of the target that the right arm serves
            swapped = natural[side] != 0
            if swapped and not stage.swap:
                continue
            partners: dict[tuple[float, float], list[HandCandidate]] = {}
            for b in paths.within_reach(1 - side, 1):
                partners.setdefault((b.turntable, b.freedom.share), []).append(b)
            for a in paths.within_reach(side, 0):
                for b in partners.get((a.turntable, 2.0 - a.freedom.share), []):
                    cost = self._shared_cost(a, swapped) + self._cost(a) + self._cost(b)
                    pairs.append((cost, (a, b)))
        return pairs

    def _suggested(
        self, target: FlatteningTarget, stage: Stage, paths: HandPaths
    ) -> list[tuple[float, Hands]]:
        return self._singles(target, paths, suggested=True)

    def _others(
        self, target: FlatteningTarget, stage: Stage, paths: HandPaths
    ) -> list[tuple[float, Hands]]:
        return self._singles(target, paths, suggested=False)

    def _singles(
        self, target: FlatteningTarget, paths: HandPaths, *, suggested: bool
    ) -> list[tuple[float, Hands]]:
        natural = natural_assignment(target)
        singles: list[tuple[float, Hands]] = []
        for side, arm in itertools.product((0, 1), repeat=2):
            if (arm == suggested_arm(target.hands[side])) != suggested:
                continue
            for c in paths.within_reach(side, arm):
                if c.freedom.share == 1.0:
                    cost = self._shared_cost(c, natural[side] != arm) + self._cost(c)
                    singles.append((cost, (c, None) if arm == 0 else (None, c)))
        return singles

    def _cost(self, c: HandCandidate) -> float:
        w = self._settings.weights
        return (
            w.offset * abs(c.freedom.offset)
            + w.tilt * abs(c.freedom.tilt - w.preferred_tilt)
            + 0.5 * w.share * abs(c.freedom.share - 1.0)
        )

    def _shared_cost(self, c: HandCandidate, swapped: bool) -> float:
        w = self._settings.weights
        return w.turntable * abs(c.turntable) + w.swap * swapped


def suggested_arm(hand: HandTarget) -> int:
    """Choose the arm on the side to which a hand pulls.

    A pull away from the robot or towards it (|x| of the direction at most 1e-3) is a tie: the side
    of the grasp point decides, and on the middle line the right arm is chosen.

    Returns:
        0, the right arm, for a pull towards lesser world x; 1, the left arm, for one towards
        greater x.
    """
    towards = float(hand.pull_direction[0])
    if abs(towards) <= _STRAIGHT:
        towards = float(hand.p_WG[0])
    return 0 if towards <= 0.0 else 1


def natural_assignment(target: FlatteningTarget) -> tuple[int, int]:
    """Assign an arm to hand 0 and hand 1.

    The right arm serves the hand further to the right (lesser world x).
    """
    x = [hand.p_WG[0] for hand in target.hands]
    return (0, 1) if x[0] <= x[1] else (1, 0)


def _corner_indices(positions: Array, paths: list[Array]) -> tuple[int, ...]:
    """Return the index at which each piece passes its middle pose, from the lengths of its two
    legs.
    """
    indices = []
    for (_, first, last), path in zip(PIECES, paths, strict=True):
        legs = np.linalg.norm(np.diff(positions[first : last + 1], axis=0), axis=1)
        indices.append(round(float(legs[0] / max(legs.sum(), 1e-12)) * (len(path) - 1)))
    return tuple(indices)
