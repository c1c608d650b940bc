"""Every published experiment, small, from its command to its page.

That it runs, and that nobody takes it for the result.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.harness.registry import find, results_type
from benchmarks.harness.report import load_report
from benchmarks.published.summary import summary
from unwrinkle.cli import app
from unwrinkle.models.errors import InputError

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end, pytest.mark.long]

#: What a quick run must have worked out.
FOUND: dict[str, Callable[[Any], bool]] = {
    "table1": lambda results: results.readings["forward"].runs == 2,
    "table2": lambda results: all(cell.runs == 1 for cell in results.cells.values()),
    "sensitivity": lambda results: [each.runs for each in results.conditions] == [1, 1],
    "garments": lambda results: len(results.cells["bunched"]) == 2,
    "trajectories": lambda results: results.methods["ours"].clean == 4,
    "grasps": lambda results: results.attempts == 3,
}


@pytest.mark.parametrize("name", sorted(FOUND))
def test_quick_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["bench", name, "--quick", "--json", f"{name}.json", "--markdown", f"{name}.md"]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0
    report = load_report(Path(f"{name}.json"), results_type(find(name)))
    assert report.quick and FOUND[name](report.results)
    page = Path(f"{name}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# Benchmark: {name} (quick: a smaller sample)")
    assert "simulated" in page or "The robot is a model" in page
    assert Path(f"{name}.png").stat().st_size > 10_000
    with pytest.raises(InputError):
        summary(tmp_path)
