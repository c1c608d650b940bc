"""The policy of the closed loop: which wrinkle next, with how many arms, and when to stop. Pure
functions of values.

- Flat: no wrinkle reaches the sensor's halting pull, none is higher than the scenario's halting
  height, and the garment's layers and heights say that it is flat. A garment that is not flat but
  has no wrinkle worth pulling ends the loop with its state: wrinkled, folded or crumpled, or not
  seen well enough.
- Wrinkles are pulled in the scenario's order (see `wrinkle_order`), with two arms first; without a
  motion for two arms, the next wrinkle; then with one arm, in the same order.
- After a missed grasp the same wrinkle is tried again a few times, then abandoned.
- After actions in a row without effect: first the next wrinkle, then one arm, then stop.
- Abandoned wrinkles count again once an action has had an effect.
- Looks in a row without a usable observation: stop.

All thresholds are settings of the scenario's `loop`.
"""

import dataclasses as dc
import math
from dataclasses import dataclass
from typing import Any, Protocol, Self

from unwrinkle.flattening.observation import GarmentFeatures, WrinkleFeatures
from unwrinkle.flattening.wrinkle_order import in_order
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.models.shared import Shared
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.folds.ridge_kinds import RidgeKind

#: Numbers of arms to try, in order, by the scenario's choice.
ARMS = {"any": ("dual", "single"), "dual": ("dual",), "single": ("single",)}
#: Reasons of abandoned wrinkles that a message lists at most.
_MOST_REASONS = 4


@dataclass(frozen=True)
class PullDecision(Shared):
    """Decision to pull a wrinkle.

    Attributes:
        wrinkle: to pull.
        arms: `dual` or `single`.
    """

    wrinkle: WrinkleFeatures
    arms: str


@dataclass(frozen=True)
class Stop(Shared):
    """Decision to stop.

    Attributes:
        flat: whether the garment is flat.
        reason: why.
        state: of the garment, where that is the reason; None where something else is.
    """

    flat: bool
    reason: str
    state: GarmentState | None = None


@dataclass(frozen=True)
class AbandonedWrinkle(Shared):
    """A wrinkle that is not pulled any more.

    Its place, with how many arms it was tried, and why it was abandoned.
    """

    centre: tuple[float, float]
    angle: float
    arms: str
    reason: str


@dataclass(frozen=True)
class LastAction(Shared):
    """The last action.

    Attributes:
        centre, angle, arms: of the wrinkle that was pulled.
        largest, total: volumes of the wrinkles worth pulling before it, mm^3; see
            `GarmentFeatures.volumes`.
        missed: whether a gripper held no cloth.
        judged: whether its effect was observed already.
    """

    centre: tuple[float, float]
    angle: float
    arms: str
    largest: float
    total: float
    missed: bool = False
    judged: bool = False


@dataclass(frozen=True)
class PolicyState(Shared):
    """State of the policy between observations.

    Attributes:
        looks: taken.
        blind: looks in a row without a usable observation.
        actions: motions executed, missed grasps included.
        idle: actions in a row without effect.
        misses: missed grasps in a row at one wrinkle.
        tried: abandoned wrinkles.
        last: the last action.
    """

    looks: int = 0
    blind: int = 0
    actions: int = 0
    idle: int = 0
    misses: int = 0
    tried: tuple[AbandonedWrinkle, ...] = ()
    last: LastAction | None = None

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers, strings and lists."""
        return dc.asdict(self)

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """Rebuild what `to_json` returned.

        Raises:
            InputError: the data are damaged.
        """
        try:
            counts = {
                name: int(data[name]) for name in ("looks", "blind", "actions", "idle", "misses")
            }
            if min(counts.values()) < 0 or set(data) != {f.name for f in dc.fields(cls)}:
                raise ValueError("its fields")
            last = None if data["last"] is None else LastAction(**_placed(data["last"]))
            tried = tuple(AbandonedWrinkle(**_placed(item)) for item in data["tried"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the state of the policy is damaged ({error}); begin a new run, without --resume"
            ) from None
        return cls(tried=tried, last=last, **counts)


class Policy(Protocol):
    """Rule that chooses the next action: this module's `decide`, or a laboratory's own."""

    def decide(
        self, features: GarmentFeatures, state: PolicyState, rules: LoopSettings
    ) -> PullDecision | Stop:
        """Choose a wrinkle of the observation and the number of arms, or stop.

        It is asked again where a wrinkle has no target or no verified motion; that wrinkle is then
        the last of `state.tried`, and must not be chosen again with the same arms.

        Args:
            features: of the observation, wrinkles largest first.
            state: what happened before.
            rules: of the scenario's `loop`, with the numbers of arms that may be used.
        """
        ...


def after_observation(
    state: PolicyState, features: GarmentFeatures, rules: LoopSettings
) -> PolicyState:
    """Count an observation, and judge by it what the last action changed.

    An action had an effect if the largest wrinkle, or all wrinkles worth pulling together, have
    lost at least the share `least_gain` of their volume: of two equal wrinkles one may be gone
    while the largest is as large as before.
    """
    state = dc.replace(state, looks=state.looks + 1, blind=0)
    last = state.last
    if last is None or last.judged:
        return state
    state = dc.replace(state, last=dc.replace(last, judged=True))
    if last.missed:
        return state
    kept = 1.0 - rules.least_gain
    largest, total = features.volumes(rules)
    if largest <= kept * last.largest or total <= kept * last.total:
        return dc.replace(state, idle=0, misses=0, tried=())
    state = dc.replace(state, idle=state.idle + 1)
    if state.idle < rules.idle_next_wrinkle:
        return state
    reason = f"{state.idle} actions in a row changed nothing"
    return _abandoned(state, last.centre, last.angle, last.arms, reason)


def after_blind_look(
    state: PolicyState,
    reason: str,
    rules: LoopSettings,
    *,
    empty: bool = False,
    unseen: float = 0.0,
) -> tuple[PolicyState, Stop | None]:
    """Count a look without a usable observation, and say whether to stop.

    A sensor that cannot tell a single layer from the table sees nothing of a flat garment. Where it
    saw a garment that was then pulled, an empty table may be a flat garment, and the stop says so.

    Args:
        state: before the look.
        reason: why there is no observation.
        rules: of the loop.
        empty: whether the table was seen without a garment on it.
        unseen: least height of a garment that the sensor can tell from the table, m.
    """
    state = dc.replace(state, looks=state.looks + 1, blind=state.blind + 1)
    if state.blind < rules.blind_looks:
        return state, None
    if empty and unseen > rules.thickest_layer and state.last is not None:
        return state, Stop(
            False,
            f"{GarmentState.UNSEEN}: nothing stands {1e3 * unseen:.1f} mm above the table any "
            "more, and this sensor does not tell a flat garment from the table",
            GarmentState.UNSEEN,
        )
    return state, Stop(False, f"nothing usable seen in {state.blind} looks: {reason}")


def decide(
    features: GarmentFeatures, state: PolicyState, rules: LoopSettings
) -> PullDecision | Stop:
    """Choose the next action."""
    if features.beyond > rules.most_beyond_table:
        return Stop(
            False,
            f"{features.beyond:.0%} of the garment lies beyond the table's edges, at most "
            f"{rules.most_beyond_table:.0%} may; lay it back",
        )
    worth = features.worth_pulling(rules)
    if not worth and features.along_edge > rules.most_along_edge:
        return Stop(
            False,
            f"{features.along_edge:.0%} of the garment's outline runs along the table's edge, at "
            f"most {rules.most_along_edge:.0%} may; it hangs over, lay it back",
        )
    if not worth:
        wrinkles = [each for each in features.wrinkles if each.kind is RidgeKind.WRINKLE]
        pull = max((wrinkle.pull for wrinkle in wrinkles), default=0.0)
        height = max((wrinkle.height for wrinkle in wrinkles), default=0.0)
        found = (
            f"{len(wrinkles)} wrinkles, the largest pull {1e3 * pull:.1f} mm of "
            f"{1e3 * features.halting_pull:.1f} mm, the highest {1e3 * height:.1f} mm of "
            f"{1e3 * rules.halting_height:.1f} mm"
        )
        if features.state is not GarmentState.FLAT:
            reasons = "; ".join(features.reasons)
            return Stop(False, f"{features.state}: {reasons}; no wrinkle to pull", features.state)
        return Stop(True, f"flat: {found}", GarmentState.FLAT)
    if state.actions >= rules.actions:
        return Stop(
            False,
            f"not flat after {state.actions} actions: {len(worth)} wrinkles are left, the largest "
            f"asks for a pull of {1e3 * worth[0].pull:.1f} mm and is "
            f"{1e3 * worth[0].height:.1f} mm high; allow more actions",
        )
    levels = ARMS[rules.arms]
    if state.idle >= rules.idle_one_arm:
        levels = levels[1:]
    if state.idle >= rules.idle_stop or not levels:
        return Stop(False, f"{state.idle} actions in a row changed nothing{_reasons(state)}")
    ordered = in_order(worth, rules.order)
    for arms in levels:
        for wrinkle in ordered:
            if not any(
                item.arms == arms and _same(item.centre, item.angle, wrinkle, rules)
                for item in state.tried
            ):
                return PullDecision(wrinkle, arms)
    return Stop(
        False, f"no motion for any of the {len(worth)} wrinkles that are left{_reasons(state)}"
    )


def after_refusal(state: PolicyState, decision: PullDecision, reason: str) -> PolicyState:
    """Abandon a wrinkle for which there is no motion with so many arms."""
    wrinkle = decision.wrinkle
    return _abandoned(state, wrinkle.centre, wrinkle.angle, decision.arms, reason)


def after_action(
    state: PolicyState,
    decision: PullDecision,
    features: GarmentFeatures,
    rules: LoopSettings,
    *,
    missed: bool,
) -> PolicyState:
    """Count an action.

    Args:
        state: before it.
        decision: that was executed.
        features: of the observation that it was decided on.
        rules: of the loop.
        missed: whether a gripper held no cloth, so that nothing was pulled.
    """
    wrinkle = decision.wrinkle
    again = (
        state.last is not None
        and state.last.missed
        and _same(state.last.centre, state.last.angle, wrinkle, rules)
    )
    misses = (state.misses if again else 0) + 1 if missed else 0
    largest, total = features.volumes(rules)
    state = dc.replace(
        state,
        actions=state.actions + 1,
        misses=misses,
        last=LastAction(
            wrinkle.centre, wrinkle.angle, decision.arms, largest, total, missed=missed
        ),
    )
    if misses < rules.grasp_attempts:
        return state
    reason = f"the grasp missed {misses} times"
    return dc.replace(
        _abandoned(state, wrinkle.centre, wrinkle.angle, decision.arms, reason), misses=0
    )


def _abandoned(
    state: PolicyState, centre: tuple[float, float], angle: float, arms: str, reason: str
) -> PolicyState:
    item = AbandonedWrinkle(centre, angle, arms, reason)
    return dc.replace(state, tried=(*state.tried, item))


def _same(
    centre: tuple[float, float], angle: float, wrinkle: WrinkleFeatures, rules: LoopSettings
) -> bool:
    """Whether a wrinkle is the one seen earlier at a place (m) and an angle (rad)."""
    turned = abs((angle - wrinkle.angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
    near = math.dist(centre, wrinkle.centre) < rules.same_wrinkle_distance
    return near and turned < rules.same_wrinkle_angle


def _reasons(state: PolicyState) -> str:
    """The last reasons why wrinkles were abandoned, each once."""
    reasons = list(dict.fromkeys(f"{item.arms}: {item.reason}" for item in state.tried))
    return "".join(f"; {reason}" for reason in reasons[-_MOST_REASONS:])


def _placed(data: dict[str, Any]) -> dict[str, Any]:
    x, y = (float(value) for value in data["centre"])
    kept = [key for key in ("angle", "largest", "total") if key in data]
    numbers: dict[str, Any] = {key: float(data[key]) for key in kept}
    if not all(math.isfinite(value) for value in (x, y, *numbers.values())):
        raise ValueError("a number that is not finite")
    return {**data, **numbers, "centre": (x, y)}
