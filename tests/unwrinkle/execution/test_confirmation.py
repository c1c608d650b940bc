"""The operator is shown a plan, and confirms it by its hash only."""

import io
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from unwrinkle.execution.confirmation import CHARACTERS, Confirmation
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verifier import verify


@pytest.mark.parametrize(
    ("typed", "refusal"),
    [("{hash}", ""), ("{hash} ", ""), ("yes", "did not confirm"), ("", "did not confirm")],
)
def test_the_hash_alone_confirms(
    cell: Cell,
    plan: FlatteningPlan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    typed: str,
    refusal: str,
) -> None:
    said = io.StringIO()
    console = Console(file=said, width=200)
    answer = typed.format(hash=plan.content_hash[:CHARACTERS])
    monkeypatch.setattr("builtins.input", lambda *_: answer)
    ask = Confirmation(console)
    ask.preview = tmp_path / "preview.html", cell
    verdict = verify(plan, cell)
    found = ask(plan, verdict)
    assert found == "" if not refusal else refusal in found
    assert (tmp_path / "preview.html").stat().st_size > 1e5
    assert verdict.summary() in said.getvalue()


def test_without_a_terminal_nothing_is_confirmed(
    plan: FlatteningPlan, cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_terminal(*_: object) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", no_terminal)
    ask = Confirmation(Console(file=io.StringIO()))
    verdict = SimpleNamespace(summary=lambda: "verified")
    assert "no terminal" in ask(plan, verdict)  # type: ignore[arg-type]
