"""From a wrinkle to a plan: computed when asked for, once per request."""

import time

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from unwrinkle.flattening.messages import Analysed, Planned, PlanRequest
from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import NoTarget
from unwrinkle.planning.search import planner
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.systems.latest import Latest

_Question = tuple[Analysed, PlanRequest]


class FlatteningPlanner(LeafSystem):
    """Plans what is requested of the wrinkles that were found, and offers only plans that pass the verification.

    Inputs: `analysis` (`Analysed`), `request` (`PlanRequest`); output: `plan` (`Planned`).
    """

    def __init__(self, cell: Cell, settings: PlannerSettings | None = None) -> None:
        """Build the planner's models of the cell (a second or so)."""
        super().__init__()
        self._planner, self._cell = planner.FlatteningPlanner(cell, settings), cell
        self._rules = cell.scenario.loop
        analysis = self.DeclareAbstractInputPort("analysis", AbstractValue.Make(Analysed()))
        request = self.DeclareAbstractInputPort("request", AbstractValue.Make(PlanRequest()))
        self.DeclareAbstractOutputPort(
            "plan",
            lambda: AbstractValue.Make(Planned()),
            self._calc,
            {self.input_port_ticket(port.get_index()) for port in (analysis, request)},
        )
        self._latest = Latest(self._plan, lambda a, b: a[0] is b[0] and a[1] is b[1])

    def _calc(self, context: Context, output: AbstractValue) -> None:
        request = self.get_input_port(1).Eval(context)
        if request.number == 0:  # do not compute what nobody asked about
            output.set_value(Planned(reason="no plan was requested yet"))
            return
        output.set_value(self._latest((self.get_input_port(0).Eval(context), request)))

    def _plan(self, question: _Question) -> Planned:
        analysed, request = question
        clock = time.perf_counter()

        def refused(reason: str) -> Planned:
            seconds = time.perf_counter() - clock
            return Planned(request.number, None, reason, seconds, request)

        if analysed.analysis is None or analysed.number != request.look:
            return refused(
                f"request {request.number} is about look {request.look}, the newest analysis is "
                f"of look {analysed.number}{': ' if analysed.reason else ''}{analysed.reason}"
            )
        try:
            target = analysed.analysis.target_for(request.wrinkle)
            if isinstance(target, NoTarget):
                return refused(target.reason)
            target = target.pulled_further(self._rules.pull_gain, self._rules.pull_extra)
            found = plan_verified(
                self._planner, self._cell, target, start=request.start, arms=request.arms
            )
            result = found.result
        except InputError as error:
            return refused(" ".join(str(error).split()))
        reason = ""
        if result.plan is None:
            reason = "no motion" if result.failure is None else result.failure.message
        seconds = time.perf_counter() - clock
        return Planned(request.number, result, reason, seconds, request)
