"""From a plan to its verdict: computed when asked for, once per plan."""

import time
from collections.abc import Callable

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from unwrinkle.flattening.messages import Planned, Verified
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.systems.latest import Latest

#: Asks whoever is responsible; an answer that is not empty says why the plan must not be run.
Approve = Callable[[FlatteningPlan, Verdict], str]


class PlanVerification(LeafSystem):
    """Verifies a plan from where the robot stands. Input: `plan` (`Planned`); output: `verdict` (`Verified`)."""

    def __init__(self, cell: Cell, approve: Approve | None = None) -> None:
        """Keep the cell that plans are verified in.

        Args:
            cell: where.
            approve: asked about a plan that passed; None approves.
        """
        super().__init__()
        self._cell, self._approve = cell, approve
        port = self.DeclareAbstractInputPort("plan", AbstractValue.Make(Planned()))
        self.DeclareAbstractOutputPort(
            "verdict",
            lambda: AbstractValue.Make(Verified()),
            self._calc,
            {self.input_port_ticket(port.get_index())},
        )
        self._latest = Latest(self._verify, lambda a, b: a is b)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._latest(self.get_input_port(0).Eval(context)))

    def _verify(self, planned: Planned) -> Verified:
        plan = None if planned.result is None else planned.result.plan
        if plan is None:
            return Verified(planned.number, reason=planned.reason or "there is no plan")
        clock = time.perf_counter()
        try:
            verdict = verify(plan, self._cell, start=planned.request.start)
        except InputError as error:
            seconds = time.perf_counter() - clock
            reason = " ".join(str(error).split())
            return Verified(planned.number, plan.content_hash, None, seconds, reason)
        seconds = time.perf_counter() - clock
        refusal = self._approve(plan, verdict) if self._approve and verdict.passed else ""
        if refusal:
            return Verified(planned.number, plan.content_hash, None, seconds, refusal)
        return Verified(planned.number, plan.content_hash, verdict, seconds)
