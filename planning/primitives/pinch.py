"""Pinch of a fold from above by one arm: the blades move down along their own axis, close, and lift
straight up.

Both tips should be at equal height. The upper blade is the shorter one, so the tool leans slightly
past the vertical, outside the scenario's window of tilts, which applies to sliding the lower blade
under cloth. Paths are checked by the collision model of the flattening search; they have no timing
and are not verified.
"""

import itertools
from collections import Counter
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.blades import Blades, load_blades
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.hand_paths import follow_branches
from unwrinkle.planning.search.key_poses import tool_poses, tool_rotation
from unwrinkle.planning.search.transit import TransitPlanner

_ARMS = ("right", "left")


def _radians(*degrees: float) -> tuple[float, ...]:
    return tuple(float(angle) for angle in np.radians(degrees))


@dataclass(frozen=True)
class PinchSettings:
    """The shape of the motion (m) and the freedoms of the search (rad, cheapest first).

    Attributes:
        approach: length of the path down along the blades' axis.
        lift: height of the straight lift.
        depth: of the lower tip below the crest; reduced where `table_gap` requires it.
        table_gap: least distance of the tips from the table.
        leans: of the blades' axis from the direction with both tips at equal height; positive
            raises the upper tip.
        offsets: of the closing direction from perpendicular to the fold.
        turntable: angles of the turn-table.
        step: distance of the points at which the path is solved.
        most: limit of the combinations of freedoms whose paths are checked for collision.
        transit_budget: of one transit found by sampling, s.
        seed: of the sampling.
    """

    approach: float = 0.12
    lift: float = 0.10
    depth: float = 0.020
    table_gap: float = 0.003
    leans: tuple[float, ...] = _radians(0, 8, -8, 17)
    offsets: tuple[float, ...] = _radians(0, 15, -15, 30, -30)
    turntable: tuple[float, ...] = _radians(0, 15, -15, 30, -30, 45, -45)
    step: float = 0.010
    most: int = 60
    transit_budget: float = 1.0
    seed: int = 0


@dataclass(frozen=True, eq=False)
class PinchPlan:
    """A collision-free pinch.

    Attributes:
        arm: 0 right, 1 left; the other one stays at home.
        turntable: rad.
        tilt: of the tool below the horizontal, rad; above pi/2 it leans back.
        offset: of the closing direction from perpendicular to the fold, rad.
        X_WT: (4, 4) of the tool centre point when the blades are down.
        path: (N, axes) configurations from above to the pinch and up, rad.
        pinch_index: index of the configuration in which the blades are down.
        transit: (M, axes) corners of the transit from home, rad.
    """

    arm: int
    turntable: float
    tilt: float
    offset: float
    X_WT: Array
    path: Array
    pinch_index: int
    transit: Array


@dataclass(frozen=True)
class NoPinch:
    """Failure: no arm can pinch the fold.

    Attributes:
        cause: far-reach, limits, collision or transit.
        reason: one sentence with the figures.
    """

    cause: str
    reason: str


def level_tilt(blades: Blades, opening: float) -> float:
    """Compute the tilt below the horizontal, rad, at which both tips of the open blades are at
    equal height.
    """
    apart = opening + blades.thickness
    return float(np.arctan2(apart, blades.upper_end - blades.lower_end))


def pinch_pose(
    p_WG: Array, direction: Array, tilt: float, tip_height: float, blades: Blades, opening: float
) -> Array:
    """Compute X_WT (4, 4) of the tool whose open blades stand on both sides of a fold.

    The blades' middle line passes through the fold half way between its crest and the tips.

    Args:
        p_WG: (3,) the fold's crest.
        direction: (2,) unit, across the fold, from the lower to the upper blade.
        tilt: of the tool below the horizontal, rad.
        tip_height: world z of the lower one of the tips.
        blades: geometry of the blades.
        opening: distance between them, m.
    """
    R_WT = tool_rotation(direction, tilt)
    y, z = blades.middle(opening)
    outer = 2.0 * blades.thickness + opening
    ends = ((0.0, blades.lower_end), (outer, blades.upper_end))
    lowest = min(R_WT[2, 1] * a + R_WT[2, 2] * end for a, end in ends)
    inner = (
        (blades.thickness, blades.lower_end),
        (blades.thickness + opening, blades.upper_end),
    )
    lowest = min(lowest, *(R_WT[2, 1] * a + R_WT[2, 2] * end for a, end in inner))
    p_WT = np.array([p_WG[0], p_WG[1], tip_height - lowest])
    # The middle line in the world: p_WT + R (0, y, z) + s R z.
    middle = R_WT @ np.array([0.0, y, z])
    half = 0.5 * (p_WG[2] + tip_height)
    s = (half - (p_WT[2] + middle[2])) / R_WT[2, 2]
    p_WT[:2] -= middle[:2] + s * R_WT[:2, 2]
    return np.asarray(tool_poses(p_WT, R_WT))


class PinchPlanner:
    """Planner of pinches in one cell."""

    def __init__(self, cell: Cell, settings: PinchSettings | None = None) -> None:
        """Build the models of the cell once."""
        self.settings = PinchSettings() if settings is None else settings
        self.blades = load_blades()
        self.opening = cell.scenario.gripper.opening
        self._table = cell.table.height
        self._kinematics = Kinematics(cell)
        self._contact = CollisionModel(cell, contact=True)
        self._transits = TransitPlanner(
            cell,
            self._contact.with_contact(False),
            self.settings.transit_budget,
            self.settings.seed,
        )
        self._robot = cell.robot
        self._home = np.array(cell.robot.named_states["home"], dtype=float)

    def tip_height(self, crest: float) -> float:
        """Compute the world z of the lower tip when down, for a crest at world z `crest`, m."""
        return max(crest - self.settings.depth, self._table + self.settings.table_gap)

    def plan(self, p_WG: Array, across: Array) -> PinchPlan | NoPinch:
        """Find an arm, a turn-table angle and a posture that pinch a fold, or the cause of failure.

        Args:
            p_WG: (3,) the fold's crest, world, m.
            across: (2,) unit, horizontal, across the fold; its sign does not matter.

        Raises:
            InputError: the point is not three finite numbers, or the direction is not a unit vector
                of two.
        """
        p_WG, across = np.asarray(p_WG, dtype=float), np.asarray(across, dtype=float)
        if p_WG.shape != (3,) or not np.isfinite(p_WG).all():
            raise InputError(f"pinch: point {p_WG} must be three finite numbers, m")
        if across.shape != (2,) or not abs(float(np.hypot(*across)) - 1.0) < 1e-6:
            raise InputError(f"pinch: direction {across} must be a unit vector of two")
        choices, poses = self._choices(p_WG, across)
        missing = np.stack(
            [
                self._kinematics.missing_reach(arm, turn, poses)
                for arm, turn in itertools.product((0, 1), self.settings.turntable)
            ]
        ).max(axis=-1)
        if missing.min() > 0.0:
            return NoPinch(
                "far-reach",
                f"the fold at ({p_WG[0]:.3f}, {p_WG[1]:.3f}) lies {missing.min():.3f} m beyond "
                "both arms' reach",
            )
        return self._first_free(choices, poses, missing)

    def _choices(self, p_WG: Array, across: Array) -> tuple[list[tuple[float, float]], Array]:
        """List tilts and offsets, cheapest first, with their key poses (n, 3, 4, 4).

        Above, down, lifted.
        """
        level = level_tilt(self.blades, self.opening)
        height = self.tip_height(float(p_WG[2]))
        choices, poses = [], []
        for offset, lean, sign in itertools.product(
            self.settings.offsets, self.settings.leans, (1.0, -1.0)
        ):
            c, s = sign * np.cos(offset), sign * np.sin(offset)
            direction = np.array([c * across[0] - s * across[1], s * across[0] + c * across[1]])
            down = pinch_pose(p_WG, direction, level - lean, height, self.blades, self.opening)
            above, lifted = down.copy(), down.copy()
            above[:3, 3] -= self.settings.approach * down[:3, 2]
            lifted[2, 3] += self.settings.lift
            choices.append((level - lean, offset))
            poses.append([above, down, lifted])
        return choices, np.array(poses)

    def _first_free(
        self, choices: list[tuple[float, float]], poses: Array, missing: Array
    ) -> PinchPlan | NoPinch:
        """Return the first combination with a free path; `missing` is (arms * turns, n), m."""
        turns = self.settings.turntable
        solvable = np.zeros(missing.shape, dtype=bool)
        for row, (arm, turn) in enumerate(itertools.product((0, 1), turns)):
            near = np.flatnonzero(missing[row] <= 0.0)
            if len(near):
                key = poses[near].reshape(-1, 4, 4)
                within = self._kinematics.inverse(arm, turn, key, tolerance=1e-6).within.any(-1)
                solvable[row, near] = within.reshape(-1, poses.shape[1]).all(-1)
        if not solvable.any():
            return NoPinch("limits", "no posture within the axes' limits at any turn-table angle")
        colliding: Counter[tuple[str, str]] = Counter()
        refused = tried = 0
        for choice, turn in itertools.product(range(len(choices)), range(len(turns))):
            for arm in self._nearest_first(poses[choice, 1, :2, 3]):
                if not solvable[arm * len(turns) + turn, choice] or tried >= self.settings.most:
                    continue
                tried += 1
                X = self._line(poses[choice])
                for path in self._paths(arm, turns[turn], X):
                    if not self._contact.path_free(path):
                        pair = next(filter(None, map(self._contact.colliding_pair, path)), None)
                        colliding[pair or ("", "")] += 1
                        continue
                    transit = self._transits.plan(self._home, path[0])
                    if transit is None:
                        refused += 1
                        continue
                    tilt, offset = choices[choice]
                    down = round(self.settings.approach / self.settings.step)
                    return PinchPlan(
                        arm,
                        turns[turn],
                        tilt,
                        offset,
                        poses[choice, 1],
                        path,
                        down,
                        transit.points,
                    )
        if refused:
            return NoPinch("transit", f"no free transit from home to any of {refused} free pinches")
        if not colliding:
            return NoPinch(
                "limits", "no posture stays within the limits along the path down and up"
            )
        (a, b), count = colliding.most_common(1)[0]
        return NoPinch(
            "collision",
            f"all {sum(colliding.values())} postures collide, {count} of them {a} with {b}",
        )

    def _nearest_first(self, p: Array) -> tuple[int, int]:
        """Return both arms, the one whose base at home is nearer to (x, y) first."""
        away = [float(np.hypot(*(self._kinematics.base(arm, 0.0)[:2, 3] - p))) for arm in (0, 1)]
        return (0, 1) if away[0] <= away[1] else (1, 0)

    def _line(self, key: Array) -> Array:
        """Compute poses (N, 4, 4) along the straight lines through the key poses."""
        above, down, lifted = key
        n = round(self.settings.approach / self.settings.step)
        m = round(self.settings.lift / self.settings.step)
        p = np.concatenate(
            [
                np.linspace(above[:3, 3], down[:3, 3], n + 1),
                np.linspace(down[:3, 3], lifted[:3, 3], m + 1)[1:],
            ]
        )
        return np.asarray(tool_poses(p, down[:3, :3]))

    def _paths(self, arm: int, turntable: float, X: Array) -> list[Array]:
        """Compute the configurations (N, axes) of every continuous branch, rad."""
        solution = self._kinematics.inverse(arm, turntable, X)
        lower, upper = self._kinematics.lower, self._kinematics.upper
        paths = []
        for q in follow_branches(solution.q, solution.within, lower, upper):
            path = np.tile(self._home, (len(q), 1))
            path[:, self._robot.turntable_axis] = turntable
            path[:, self._robot.arms[arm].axes] = q
            paths.append(path)
        return paths
