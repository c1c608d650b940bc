"""Every board, small, from its command to its page.

That it runs, and that nobody takes it for the result.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.published.summary import BOARDS, glance
from unwrinkle.cli import app
from unwrinkle.models.errors import InputError

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end, pytest.mark.alone]

# What a quick run must have worked out, by board.
FOUND = {
    "table1": lambda results: results["forward"]["runs"] == 2,
    "table2": lambda results: all(results[cell]["runs"] == 1 for cell in results["published"]),
    "levers": lambda results: [cell["runs"] for cell in results["cells"]] == [1, 1],
    "garments": lambda results: len(results["cells"]["bunched"]) == 2,
    "trajectories": lambda results: results["methods"]["ours"]["clean"] == 4,
    "grasps": lambda results: results["attempts"] == 3,
}


@pytest.mark.parametrize("name", sorted(BOARDS))
def test_quick_board(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["bench", name, "--quick", "--json", f"{name}.json", "--markdown", f"{name}.md"]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0
    report: dict[str, Any] = json.loads(Path(f"{name}.json").read_text(encoding="utf-8"))
    assert report["quick"] and FOUND[name](report["results"])
    page = Path(f"{name}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# Benchmark: {name} (quick: a smaller sample)")
    assert "simulated" in page or "The robot is a model" in page
    assert Path(f"{name}.png").stat().st_size > 10_000
    with pytest.raises(InputError, match=r"quick run, which is no result|run `unwrinkle bench"):
        glance(tmp_path)
