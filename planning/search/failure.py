"""Causes of a failed planning, with their figures and what to try."""

import math
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.robot import Cell, scoped
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.search.hand_paths import SearchLog


@dataclass(frozen=True)
class PlanFailure:
    """The cause of a failed planning.

    Attributes:
        cause: off-table, far-reach, near-limit, arm-arm, collision, transit, verification, start,
            or time.
        message: one sentence with the figures and what to try.
        missing: distance beyond the reach (far-reach) or beyond the table's edge (off-table), m;
            else None.
    """

    cause: str
    message: str
    missing: float | None = None


def off_table(target: FlatteningTarget, cell: Cell) -> PlanFailure | None:
    """Return a failure if a hand would grasp or put down beside the working table, else None."""
    for hand in target.hands:
        put = hand.p_WG[:2] + hand.pull_distance * hand.pull_direction
        for what, place in (("grasp point", hand.p_WG[:2]), ("put-down point", put)):
            beyond = float(cell.beyond_table(place))
            if not beyond <= 0.0:
                x, y = place
                return PlanFailure(
                    "off-table",
                    f"the {what} ({x:.3f}, {y:.3f}) m lies {1e3 * beyond:.0f} mm beyond the edge "
                    "of the working table; move the garment by that much towards the table's "
                    "middle",
                    beyond,
                )
    return None


def explain(kind: str, log: SearchLog, target: FlatteningTarget, cell: Cell) -> PlanFailure:
    """Derive the cause of a failed search from its log.

    Args:
        kind: `dual` or `single`.
        log: of the search.
        target: of the search.
        cell: names the arms and the garment's usual place.
    """
    head = f"no {kind}-arm motion{' in the time allowed' if log.out_of_time else ''}: "
    if log.refused:
        return PlanFailure(
            "transit",
            f"{head}none of {log.refused} free motions has a free transit from the start and back "
            "home; clear the surroundings of the table or allow a longer transit budget",
        )
    hand = log.missing_hand
    if hand is not None and math.isfinite(log.missing):
        x, y = target.hands[hand.side].p_WG[:2]
        arm = cell.robot.arms[hand.arm].name
        return PlanFailure(
            "far-reach",
            f"{head}the {arm} arm lacks {1e3 * log.missing:.0f} mm of reach to the grasp point "
            f"({x:.2f}, {y:.2f}) at its best (tilt {np.degrees(hand.freedom.tilt):.0f} deg, "
            f"turn-table {np.degrees(hand.turntable):.0f} deg); {_mend(log.missing, y)}",
            log.missing,
        )
    if log.in_collision:
        (pair, _), *_ = log.colliding.most_common(1) or [(("", ""), 0)]
        names = f" (mostly {pair[0]} and {pair[1]} come too close)" if pair[0] else ""
        sides = {cell.robot.arm_of(scoped(name)[0]) for name in pair}
        both_arms = len(sides) == 2 and None not in sides
        x, y = cell.scenario.garment_centre
        return PlanFailure(
            "arm-arm" if both_arms else "collision",
            f"{head}{log.in_collision} motions within reach all collide{names}; "
            f"move the garment nearer to ({x:.2f}, {y:.2f}) m or clear the surroundings",
        )
    if log.limit_axes:
        axes = ", ".join(sorted(log.limit_axes, key=lambda a: -log.limit_axes[a]))
        return PlanFailure(
            "near-limit",
            f"{head}a pose within reach breaks the position limit of axis {axes}; "
            "move the garment away from the robot's base or turn it",
        )
    if log.out_of_time:
        return PlanFailure("time", head + "the search was not finished; raise its time budget")
    return PlanFailure(
        "near-limit", head + "no posture follows the whole path without a jump; move the garment"
    )


def _mend(missing: float, y: float) -> str:
    """Advise how to regain a missing reach, m.

    15 degrees of tilt or of turn-table are worth about 0.10 m each.
    """
    if missing < 0.10:
        return "a steeper tilt window (75 deg), or the garment 0.1 m nearer, would do"
    return f"move the garment about {missing:.2f} m nearer to the robot (it is at y = {y:.2f})"
