"""Asking the operator about a plan that is safe, before it is run."""

from typing import TYPE_CHECKING

from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification_verdict import Verdict

if TYPE_CHECKING:
    from rich.console import Console

#: So many characters of the plan's hash have to be typed.
CHARACTERS = 6


class Confirmation:
    """Shows hash and smallest clearance, and wants the hash's first characters typed."""

    def __init__(self, console: "Console") -> None:
        """Ask on a terminal."""
        self._console = console

    def __call__(self, plan: FlatteningPlan, verdict: Verdict) -> str:
        """Ask about a plan; an answer that is not empty says why it must not be run."""
        self._console.print(verdict.summary(), highlight=False, soft_wrap=True)
        wanted = plan.content_hash[:CHARACTERS]
        try:
            typed = self._console.input(
                f"type {wanted} to move the robot, anything else to leave it: "
            )
        except EOFError:
            return "nobody confirmed the plan: there is no terminal to ask on"
        return "" if typed.strip() == wanted else "the operator did not confirm the plan"
