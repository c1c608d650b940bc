"""Drake system of the planner: a request in, a verified plan out."""

import time

from unwrinkle.flattening.flattener import Flattener
from unwrinkle.flattening.messages import Planned, PlanRequest
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import NoTarget
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.systems.function_system import FunctionSystem


class PlannerSystem(FunctionSystem):
    """Plan for a target; only plans that pass the verification are returned.

    Input: `request` (`PlanRequest`); output: `plan` (`Planned`).
    """

    def __init__(self, cell: Cell, settings: PlannerSettings | None = None) -> None:
        """Build the planner's models of the cell (about 1 s)."""
        super().__init__({"request": PlanRequest()}, ("plan", Planned()), self._plan)
        self._flattener = Flattener(cell, settings=settings)
        _ = self._flattener.planner  # built here, not during the first look

    def _plan(self, request: PlanRequest) -> Planned:
        if request.number == 0:
            return Planned(reason="no plan was requested yet")
        if isinstance(request.target, NoTarget):
            return Planned(request.number, None, request.target.reason, request=request)
        clock = time.perf_counter()
        try:
            found = self._flattener.plan(
                request.target, start=request.start, arms=request.arms, garment=request.garment
            )
        except InputError as error:
            reason = " ".join(str(error).split())
            return Planned(request.number, None, reason, time.perf_counter() - clock, request)
        seconds = time.perf_counter() - clock
        return Planned(request.number, found.result, found.reason, seconds, request)
