"""Asking the operator about a verified plan before it is run."""

from pathlib import Path
from typing import TYPE_CHECKING

from unwrinkle.models.io.files import write_text
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.viewer.overlay import PreviewSummary
from unwrinkle.viewer.preview import preview_page

if TYPE_CHECKING:
    from rich.console import Console

#: So many characters of the plan's hash have to be typed.
CHARACTERS = 6


class Confirmation:
    """Shows the plan, its hash and its smallest clearance, and wants the hash's first characters typed.

    Attributes:
        preview: where each plan's page goes, and the cell that it shows; None for no page.
    """

    def __init__(self, console: "Console") -> None:
        """Ask on a terminal."""
        self._console = console
        self.preview: tuple[Path, Cell] | None = None

    def __call__(self, plan: FlatteningPlan, verdict: Verdict) -> str:
        """Ask about a plan; an answer that is not empty says why it must not be run."""
        self._console.print(verdict.summary(), highlight=False, soft_wrap=True)
        if self.preview is not None:
            path, cell = self.preview
            page = preview_page(plan, cell, PreviewSummary.of(verdict), title=path.parent.name)
            write_text(path, page)
            self._console.print(f"look at {path}", highlight=False, soft_wrap=True)
        wanted = plan.content_hash[:CHARACTERS]
        try:
            typed = self._console.input(
                f"type {wanted} to move the robot, anything else to leave it: "
            )
        except EOFError:
            return "nobody confirmed the plan: there is no terminal to ask on"
        return "" if typed.strip() == wanted else "the operator did not confirm the plan"
