"""Transits between configurations.

A straight joint line, else lines through a via point, else RRT-Connect.
"""

import time
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.search.settings import TransitSettings

#: Index of the L axis (upper arm) in an arm's axes.
_UPPER_ARM = 1


@dataclass(frozen=True, eq=False)
class Transit:
    """A free polyline between two configurations.

    Attributes:
        points: (N, axes) corners, rad.
        kind: line, via or rrt.
    """

    points: Array
    kind: str


class TransitPlanner:
    """Plans transits in which the fingers keep their clearance from the table."""

    def __init__(
        self,
        cell: Cell,
        collision: CollisionModel,
        budget: float,
        seed: int,
        *,
        fixed_turntable: bool = False,
        settings: TransitSettings | None = None,
    ) -> None:
        """Use the given model.

        Args:
            cell: its limits bound the axes.
            collision: clearances that transits keep.
            budget: time that one RRT-Connect may take, s.
            seed: of its samples.
            fixed_turntable: never turn the turn-table, given that start and goal have it at one
                angle.
            settings: of via points and samples; None for the defaults.
        """
        self._limits, self._collision = cell.limits, collision
        self._budget, self._seed = budget, seed
        self._settings = settings = TransitSettings() if settings is None else settings
        self._weights = 0.5 * collision.reach
        self._turntable = cell.robot.turntable_axis
        self._upper_arms = [arm.axes[_UPPER_ARM] for arm in cell.robot.arms]
        self._spread = np.zeros(len(cell.robot.axes))
        if not fixed_turntable:
            self._spread[self._turntable] = settings.turntable_spread
        for arm in cell.robot.arms:
            self._spread[arm.axes] = settings.arm_spread

    def plan(self, start: Array, goal: Array) -> Transit | None:
        """Return a free transit between two configurations (axes,), rad.

        None if none was found in the budget.
        """
        if self._collision.edge_free(start, goal):
            return Transit(np.array([start, goal]), "line")
        for via in self._vias(start, goal):
            if self._collision.edge_free(start, via) and self._collision.edge_free(via, goal):
                return Transit(np.array([start, via, goal]), "via")
        points = self._rrt_connect(start, goal)
        return None if points is None else Transit(np.array(points), "rrt")

    def _vias(self, start: Array, goal: Array) -> list[Array]:
        """Return via points: the middle with the upper arms leaned back, and each end with the
        other's turn-table angle.
        """
        middle = 0.5 * (start + goal)
        vias = []
        for lean in self._settings.leans:
            raised = middle.copy()
            raised[self._upper_arms] += lean
            vias.append(raised)
        for a, b in ((start, goal), (goal, start)):
            turned = a.copy()
            turned[self._turntable] = b[self._turntable]
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
        step = self._settings.step
        b = towards if distance <= step else a + (towards - a) * (step / distance)
        if not self._collision.edge_free(a, b):
            return None
        tree.points.append(b)
        tree.parents.append(i)
        return b

    def _shortcut(self, path: list[Array], rng: np.random.Generator) -> list[Array]:
        for _ in range(self._settings.shortcuts):
            if len(path) < 3:
                break
            i = int(rng.integers(0, len(path) - 2))
            j = int(rng.integers(i + 2, len(path)))
            if self._collision.edge_free(path[i], path[j]):
                path[i + 1 : j] = []
        return path


class _Tree:
    """Search tree: configurations, each with the index of its parent."""

    def __init__(self, root: Array) -> None:
        self.points, self.parents = [root], [-1]

    def trace(self) -> list[Array]:
        """Return the configurations from the newest back to the root."""
        out, i = [], len(self.points) - 1
        while i >= 0:
            out.append(self.points[i])
            i = self.parents[i]
        return out
