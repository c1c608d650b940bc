"""Plan, verify, and try the next motion where the verification refuses one.

How every caller comes by a plan.
"""

from dataclasses import dataclass

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan, GarmentSurface
from unwrinkle.planning.search.planner import FlatteningPlanner, PlanResult
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify


@dataclass(frozen=True, eq=False)
class VerifiedResult:
    """What planning and verification gave.

    Attributes:
        result: the plan that passed, or the reason why there is none.
        verdict: of that plan; None where there is none.
        refused: verdicts of the plans that were refused before, in order.
    """

    result: PlanResult
    verdict: Verdict | None
    refused: tuple[Verdict, ...] = ()

    @property
    def plan(self) -> FlatteningPlan | None:
        """The plan that passed; None where there is none."""
        return self.result.plan if self.verdict is not None else None

    @property
    def reason(self) -> str:
        """Why there is no verified plan; empty where there is one."""
        if self.verdict is not None:
            return ""
        return "no motion" if self.result.failure is None else self.result.failure.message


def plan_verified(
    planner: FlatteningPlanner,
    cell: Cell,
    target: FlatteningTarget,
    *,
    start: Array | None = None,
    garment: GarmentSurface | None = None,
    arms: str = "any",
) -> VerifiedResult:
    """Plan a motion that passes its verification.

    Planner and verification know nothing of each other; a plan that the verification refuses is
    followed by the planner's next motion, within the planner's time budget.

    Args:
        planner: of the cell.
        cell: that plans are verified in.
        target: as for `FlatteningPlanner.plan`.
        start: as there.
        garment: as there.
        arms: as there.

    Raises:
        InputError: as `FlatteningPlanner.plan` and `verify`.
    """
    verdicts: list[Verdict] = []

    def refusal(plan: FlatteningPlan) -> str:
        verdicts.append(verify(plan, cell, start=start))
        return "" if verdicts[-1].passed else verdicts[-1].violations[0].message

    result = planner.plan(target, start=start, garment=garment, arms=arms, approve=refusal)
    passed = verdicts[-1] if result.plan is not None else None
    return VerifiedResult(result, passed, tuple(v for v in verdicts if not v.passed))
