"""Drake system of the verification: a plan in, its verdict out."""

import time

from unwrinkle.flattening.messages import Planned, Verified
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.systems.function_system import FunctionSystem


class VerificationSystem(FunctionSystem):
    """Verify a plan from the robot's posture.

    Input: `plan` (`Planned`); output: `verdict` (`Verified`).
    """

    def __init__(self, cell: Cell) -> None:
        """Keep the cell in which plans are verified."""
        super().__init__({"plan": Planned()}, ("verdict", Verified()), self._verify)
        self._cell = cell

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
        return Verified(planned.number, plan.content_hash, verdict, seconds)
