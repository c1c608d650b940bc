"""Confirmation of a plan by its hash, for `unwrinkle execute`, programs and the closed loop."""

from pathlib import Path
from typing import TYPE_CHECKING

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.viewer.overlay import PreviewSummary
from unwrinkle.viewer.preview import preview_page

if TYPE_CHECKING:
    from rich.console import Console

#: Least number of characters of the plan's hash that confirm it.
CHARACTERS = 6


def check_confirmed(plan: FlatteningPlan, typed: str) -> None:
    """Refuse a text that is not the beginning of the plan's hash.

    Raises:
        InputError: it is another text, or too short.
    """
    text = typed.strip().lower()
    if len(text) < CHARACTERS or not plan.content_hash.startswith(text):
        raise InputError(
            f"'{text[:12]}' does not confirm this plan: its hash begins with "
            f"{plan.content_hash[:CHARACTERS]}, and {CHARACTERS} characters or more are needed; "
            "nothing has moved"
        )


class Confirmation:
    """Ask the operator of the closed loop.

    A plan is shown with its hash and clearance; the first characters of the hash confirm it.

    Attributes:
        preview: path of each plan's page, and the cell it shows; None for no page.
    """

    def __init__(self, console: "Console") -> None:
        """Ask on a terminal."""
        self._console = console
        self.preview: tuple[Path, Cell] | None = None

    def __call__(self, plan: FlatteningPlan, verdict: Verdict) -> str:
        """Ask about a plan; return why it must not be executed, empty if it was confirmed."""
        self._console.print(verdict.summary(), highlight=False, soft_wrap=True)
        if self.preview is not None:
            path, cell = self.preview
            page = preview_page(plan, cell, PreviewSummary.of(verdict), title=path.parent.name)
            write_text(path, page)
            self._console.print(f"page {path}", highlight=False, soft_wrap=True)
        required = plan.content_hash[:CHARACTERS]
        try:
            typed = self._console.input(
                f"type {required} to move the robot, anything else to skip the plan: "
            )
        except EOFError:
            return "the plan was not confirmed: there is no terminal"
        try:
            check_confirmed(plan, typed)
        except InputError:
            return "the operator did not confirm the plan"
        return ""
