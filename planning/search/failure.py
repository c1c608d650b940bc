"""Why there is no plan: the cause, in words and numbers."""

import math
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.search.hand_paths import SearchLog


@dataclass(frozen=True)
class PlanFailure:
    """The cause of a failure.

    Attributes:
        cause: off-table, far-reach, near-limit, arm-arm, collision, transit, verification, start, or time.
        message: one sentence with the figures and what would mend it.
        missing: metres beyond the reach, where the cause is far-reach; beyond the edge, where it is off-table.
    """

    cause: str
    message: str
    missing: float | None = None


def off_table(target: FlatteningTarget, cell: Cell) -> PlanFailure | None:
    """Why a target cannot be served because a hand would grasp or put down beside the working table; None if it can."""
    for hand in target.hands:
        put = hand.p_WG[:2] + hand.pull_distance * hand.pull_direction
        for what, place in (("grasp point", hand.p_WG[:2]), ("put-down point", put)):
            beyond = float(cell.beyond_table(place))
            if not beyond <= 0.0:
                x, y = place
                return PlanFailure(
                    "off-table",
                    f"the {what} ({x:.3f}, {y:.3f}) m lies {1e3 * beyond:.0f} mm beyond the edge of the working "
                    f"table; move the garment by that much towards the table's middle",
                    beyond,
                )
    return None


def explain(kind: str, log: SearchLog, target: FlatteningTarget) -> PlanFailure:
    """Turn a search's log into a cause.

    Args:
        kind: `dual` or `single`.
        log: what the search met.
        target: what it searched for.
    """
    head = f"no {kind}-arm motion{' in the time allowed' if log.out_of_time else ''}: "
    if log.refused:
        return PlanFailure(
            "transit",
            f"{head}for none of {log.refused} free motions was there a free way from the start and back "
            "home; clear the surroundings of the table or allow a longer transit budget",
        )
    hand = log.missing_hand
    if hand is not None and math.isfinite(log.missing):
        x, y = target.hands[hand.side].p_WG[:2]
        arm = ("right", "left")[hand.arm]
        return PlanFailure(
            "far-reach",
            f"{head}the {arm} arm lacks {1e3 * log.missing:.0f} mm of reach to the grasp point "
            f"({x:.2f}, {y:.2f}) at its best (tilt {np.degrees(hand.freedom.tilt):.0f} deg, turn-table "
            f"{np.degrees(hand.turntable):.0f} deg); {_mend(log.missing, y)}",
            log.missing,
        )
    if log.in_collision:
        (pair, _), *_ = log.colliding.most_common(1) or [(("", ""), 0)]
        names = f" (mostly {pair[0]} and {pair[1]} come too close)" if pair[0] else ""
        both_arms = {pair[0][:2], pair[1][:2]} == {"r1", "r2"}
        return PlanFailure(
            "arm-arm" if both_arms else "collision",
            f"{head}{log.in_collision} motions within reach all collide{names}; "
            "move the garment nearer to (0, -1.10) or clear the surroundings",
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
    return PlanFailure("near-limit", head + "no branch follows the whole path; move the garment")


def _mend(missing: float, y: float) -> str:
    """What would give back the missing reach: 15 degrees of tilt or of turn-table buy about 0.10 m each."""
    if missing < 0.10:
        return "a steeper tilt window (75 deg), or the garment 0.1 m nearer, would do"
    return f"move the garment about {missing:.2f} m nearer to the robot (it is at y = {y:.2f})"
