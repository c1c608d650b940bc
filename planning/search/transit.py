"""Transits: a straight joint line, then lines through a few via points, then a small RRT-Connect."""

import time
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.robot.collision import CollisionModel

_STEP = 1.2  # reach-weighted joint distance that a tree grows by, m
_SPREAD = np.array([0.15, *2 * [0.4, 0.4, 0.4, 0.5, 0.4, 0.4]])  # rad, about the straight line
_SHORTCUTS = 30


@dataclass(frozen=True, eq=False)
class Transit:
    """A free polyline between two configurations.

    Attributes:
        points: (N, 13) corners, rad.
        kind: line, via or rrt.
    """

    points: Array
    kind: str


class TransitPlanner:
    """Plans transits with the fingers kept off the table."""

    def __init__(
        self,
        limits: Limits,
        collision: CollisionModel,
        budget: float,
        seed: int,
        *,
        fixed_turntable: bool = False,
    ) -> None:
        """Use the given limits and model; a sampling search may take `budget` seconds, from the given seed.

        With a fixed turn-table no way turns it, given that start and goal have it at one angle.
        """
        self._limits, self._collision = limits, collision
        self._budget, self._seed = budget, seed
        self._weights = 0.5 * collision.reach
        self._spread = _SPREAD.copy()
        if fixed_turntable:
            self._spread[0] = 0.0

    def plan(self, start: Array, goal: Array) -> Transit | None:
        """A free way between two configurations (13,), or None."""
        if self._collision.edge_free(start, goal):
            return Transit(np.array([start, goal]), "line")
        for via in self._vias(start, goal):
            if self._collision.edge_free(start, via) and self._collision.edge_free(via, goal):
                return Transit(np.array([start, via, goal]), "via")
        points = self._rrt_connect(start, goal)
        return None if points is None else Transit(np.array(points), "rrt")

    def _vias(self, start: Array, goal: Array) -> list[Array]:
        """Half way with the upper arms leaned back, and either end with the arms or the turn-table of the other."""
        middle = 0.5 * (start + goal)
        vias = []
        for lean in (-0.15, -0.3):
            raised = middle.copy()
            raised[[2, 8]] += lean
            vias.append(raised)
        for a, b in ((start, goal), (goal, start)):
            turned = a.copy()
            turned[0] = b[0]
            vias.append(turned)
        low, high = self._limits.lower, self._limits.upper
        return [via for via in vias if np.all(via >= low) and np.all(via <= high)]

    def _rrt_connect(self, start: Array, goal: Array) -> list[Array] | None:
        deadline = time.perf_counter() + self._budget
        rng = np.random.default_rng(self._seed)
        trees = [_Tree(start), _Tree(goal)]
        low, high = self._limits.lower, self._limits.upper
        for k in range(1, 1_000_000):
            if time.perf_counter() > deadline:
                return None
            along = start + rng.uniform() * (goal - start)
            sample = along + rng.normal(size=len(start)) * self._spread * min(2.0, 0.5 + k / 100)
            here, there = trees[k % 2], trees[1 - k % 2]
            new = self._extend(here, np.clip(sample, low, high))
            while new is not None:
                met = self._extend(there, new)
                if met is None:
                    break
                if np.allclose(met, new):
                    path = trees[0].trace()[::-1] + trees[1].trace()[1:]
                    return self._shortcut(path, rng)
        return None

    def _extend(self, tree: "_Tree", towards: Array) -> Array | None:
        distances = np.abs(np.array(tree.points) - towards) @ self._weights
        i = int(distances.argmin())
        a, distance = tree.points[i], distances[i]
        b = towards if distance <= _STEP else a + (towards - a) * (_STEP / distance)
        if not self._collision.edge_free(a, b):
            return None
        tree.points.append(b)
        tree.parents.append(i)
        return b

    def _shortcut(self, path: list[Array], rng: np.random.Generator) -> list[Array]:
        for _ in range(_SHORTCUTS):
            if len(path) < 3:
                break
            i = int(rng.integers(0, len(path) - 2))
            j = int(rng.integers(i + 2, len(path)))
            if self._collision.edge_free(path[i], path[j]):
                path[i + 1 : j] = []
        return path


class _Tree:
    """Configurations with the index of the one each was reached from."""

    def __init__(self, root: Array) -> None:
        self.points, self.parents = [root], [-1]

    def trace(self) -> list[Array]:
        """From the newest configuration back to the root."""
        out, i = [], len(self.points) - 1
        while i >= 0:
            out.append(self.points[i])
            i = self.parents[i]
        return out
