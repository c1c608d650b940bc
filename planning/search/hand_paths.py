"""Candidates of one hand: those within reach, those whose key poses have a solution, and the arm's
paths along them.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import ARM_AXES
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.robot.kinematics import InverseSolution, Kinematics
from unwrinkle.planning.search.key_poses import (
    Freedom,
    approach_direction,
    pieces,
    seven_positions,
    tool_poses,
    tool_rotation,
)
from unwrinkle.planning.search.settings import Stage

#: Greatest change of an axis between neighbouring points of a path, rad; beyond it a branch ends.
_JUMP = 0.35
#: Candidates whose key poses are solved in one call.
_BATCH = 48
#: Branches kept per candidate, the greatest distance from the limits first.
_BRANCHES = 2


@dataclass(frozen=True)
class HandCandidate:
    """One hand of the target, served by one arm with one choice of the freedoms.

    Attributes:
        side: index of the target's hand.
        arm: 0 right, 1 left.
        turntable: rad.
        freedom: offset, tilt, share.
    """

    side: int
    arm: int
    turntable: float
    freedom: Freedom


@dataclass
class SearchLog:
    """Counts of a search, from which a failure is explained.

    Attributes:
        missing: least distance beyond the reach, m, of a hand that has no candidate within reach,
            in the last stage.
        missing_hand: the candidate with that distance.
        limit_axes: poses that only the position limit of an axis forbids, by axis.
        pairs: combinations whose paths were checked for collision.
        in_collision: combinations that collide.
        colliding: counts of pairs of bodies (scoped names) that are too close at a pose.
        refused: free motions that were not accepted.
        out_of_time: whether the budget was spent.
    """

    missing: float = np.inf
    missing_hand: HandCandidate | None = None
    limit_axes: dict[str, int] = field(default_factory=dict)
    pairs: int = 0
    in_collision: int = 0
    colliding: Counter[tuple[str, str]] = field(default_factory=Counter)
    refused: int = 0
    out_of_time: bool = False


class HandPaths:
    """Solver of the candidates of one target in one stage; each is solved at most once."""

    def __init__(
        self,
        target: FlatteningTarget,
        stage: Stage,
        tilt_window: tuple[float, float],
        kinematics: Kinematics,
        log: SearchLog,
    ) -> None:
        """Use the stage's freedoms, without tilts outside the gripper's window, rad."""
        low, high = tilt_window
        self._tilts = [t for t in stage.tilts if low - 1e-9 <= t <= high + 1e-9]
        self._target, self._stage = target, stage
        self._kinematics, self._log = kinematics, log
        self._solvable: dict[HandCandidate, bool] = {}
        self._tubes: dict[tuple[HandCandidate, tuple[int, ...]], list[list[Array]]] = {}

    def within_reach(self, side: int, arm: int) -> list[HandCandidate]:
        """List the candidates whose seven poses lie within the arm's length."""
        hand = self._target.hands[side]
        turns = np.array(self._stage.turntable)
        freedoms = [
            Freedom(offset, tilt, share)
            for share in sorted({share[side] for share in self._stage.shares})
            for offset in self._stage.offsets
            for tilt in self._tilts
        ]
        if not freedoms:
            return []
        X = np.stack([self._poses(freedom, hand) for freedom in freedoms])
        missing = self._kinematics.missing_reach(arm, turns[:, None, None], X[None]).max(-1)
        near = missing <= 0.0
        if not near.any() and missing.min() < self._log.missing:
            i, j = np.unravel_index(int(missing.argmin()), missing.shape)
            self._log.missing = float(missing[i, j])
            self._log.missing_hand = HandCandidate(side, arm, float(turns[i]), freedoms[j])
        return [
            HandCandidate(side, arm, float(turns[i]), freedoms[j])
            for i, j in zip(*np.nonzero(near), strict=True)
        ]

    def solvable(
        self, candidate: HandCandidate, following: Sequence[tuple[HandCandidate, ...]]
    ) -> bool:
        """Return whether all seven poses of a candidate have a branch within the limits.

        Args:
            candidate: the candidate.
            following: combinations that the search visits next; their candidates are solved in the
                same batch.
        """
        if candidate not in self._solvable:
            batch: dict[HandCandidate, None] = {candidate: None}
            for hand in itertools.chain.from_iterable(following):
                if len(batch) == _BATCH:
                    break
                if hand.arm == candidate.arm and hand not in self._solvable:
                    batch[hand] = None
            self._solve(list(batch), candidate.arm)
        return self._solvable[candidate]

    def _solve(self, batch: list[HandCandidate], arm: int) -> None:
        X = np.stack([self._poses(c.freedom, self._target.hands[c.side]) for c in batch])
        turns = np.repeat([c.turntable for c in batch], X.shape[1])
        solution = self._kinematics.inverse(
            arm, turns, X.reshape(-1, 4, 4), iterations=5, tolerance=1e-6
        )
        within = solution.within.any(-1).reshape(len(batch), -1)
        for c, poses in zip(batch, within, strict=True):
            self._solvable[c] = bool(np.all(poses))
        self._count_limits(solution)

    def _count_limits(self, solution: InverseSolution) -> None:
        """Count, for poses that only a limit forbids, the axis that exceeds its limit most in the
        nearest branch.
        """
        rows = solution.found.any(-1) & ~solution.within.any(-1)
        q, found = solution.q[rows], solution.found[rows]
        if len(q) == 0:
            return
        excess = np.maximum(self._kinematics.lower - q, q - self._kinematics.upper)
        least = np.where(found, excess.max(-1), np.inf).argmin(-1)
        for axis in excess[np.arange(len(q)), least].argmax(-1):
            name = ARM_AXES[axis].upper()
            self._log.limit_axes[name] = self._log.limit_axes.get(name, 0) + 1

    def tubes(self, candidate: HandCandidate, counts: Sequence[int]) -> list[list[Array]]:
        """Compute the arm's paths along the three pieces, greatest distance from its limits first.

        Args:
            candidate: the candidate.
            counts: numbers of intervals of the three pieces.

        Returns:
            For each branch three arrays (count + 1, 6), rad.
        """
        key = (candidate, tuple(counts))
        if key not in self._tubes:
            hand, freedom = self._target.hands[candidate.side], candidate.freedom
            positions = seven_positions(hand, freedom, self._stage.shape)
            parts = pieces(positions, self._stage.shape.blend, list(counts))
            rotation = tool_rotation(approach_direction(hand, freedom.offset), freedom.tilt)
            X = tool_poses(np.concatenate(parts), rotation)
            solution = self._kinematics.inverse(candidate.arm, candidate.turntable, X)
            lower, upper = self._kinematics.lower, self._kinematics.upper
            found = follow_branches(solution.q, solution.within, lower, upper)
            # The last axis has more range than any path needs, so its margin is ignored.
            margin = [np.minimum(q - lower, upper - q)[:, :5].min() for q in found]
            cuts = np.cumsum([len(part) for part in parts])[:-1]
            best = np.argsort(np.minimum(margin, 0.5))[::-1][:_BRANCHES]
            self._tubes[key] = [np.split(found[i], cuts) for i in best]
        return self._tubes[key]

    def _poses(self, freedom: Freedom, hand: HandTarget) -> Array:
        rotation = tool_rotation(approach_direction(hand, freedom.offset), freedom.tilt)
        return tool_poses(seven_positions(hand, freedom, self._stage.shape), rotation)


def follow_branches(q: Array, within: NDArray[np.bool_], lower: Array, upper: Array) -> list[Array]:
    """Follow the branches of inverse kinematics along a path.

    Args:
        q: (N, 8, 6) branches of each point, rad.
        within: (N, 8) branches within the limits.
        lower: (6,) lower position limits, rad.
        upper: (6,) upper position limits, rad.

    Returns:
        Continuous sequences (N, 6), rad. The last axis may be shifted by a full turn to stay within
        its limits.
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
