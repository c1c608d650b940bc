"""The command, reports, and what all benchmarks have in common."""

import inspect
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from benchmarks.harness import command, registry
from benchmarks.harness.report import Progress, load_report
from unwrinkle import cli
from unwrinkle.models.errors import InputError


@dataclass(frozen=True)
class Draws:
    draw: float
    tasks: int


class _Fake(ModuleType):
    """A benchmark that draws one number."""

    def run(self, *, quick: bool, seed: int, progress: Progress) -> Draws:
        progress(1, 2, "drawing")
        progress(2, 2, "drawing")
        return Draws(np.random.default_rng(seed).uniform(), 2 if quick else 40)

    def table(self, results: Draws) -> str:
        return f"| tasks |\n|---|\n| {results.tasks} |"


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "find", lambda name: _Fake(name))


def _bench(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert isinstance(stop.value.code, int)
    return stop.value.code


@pytest.mark.usefixtures("fake")
def test_report_is_complete_and_repeatable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reports = []
    for name in ("a.json", "b.json"):
        assert _bench(monkeypatch, "draws", "--seed", "3", "--json", tmp_path / name) == 0
        reports.append(load_report(tmp_path / name, Draws))
    first, second = reports
    assert first.results == second.results and first.results.tasks == 40
    assert (first.seed, first.quick) == (3, False)
    assert first.command == "unwrinkle bench draws --seed 3"
    assert first.machine.cores >= 1 and first.machine.memory > 2**28
    named = {"unwrinkle", "drake", "numpy", "scipy", "opencv", "toppra", "ruckig"}
    assert all(first.versions[name] for name in named)


@pytest.mark.usefixtures("fake")
def test_quick_is_marked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--json", tmp_path / "r.json", "--markdown", tmp_path / "r.md"]
    assert _bench(monkeypatch, "draws", "--quick", *files) == 0
    assert json.loads((tmp_path / "r.json").read_text())["quick"] is True
    page = (tmp_path / "r.md").read_text()
    assert page.startswith("# Benchmark: draws (quick: a smaller sample)\n")
    assert "unwrinkle bench draws --seed 0 --quick" in page
    assert "| 2 |" in page
    assert capsys.readouterr().out == page


@pytest.mark.usefixtures("fake")
def test_a_kept_report_gives_the_same_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, first, again = (tmp_path / name for name in ("r.json", "a.md", "b.md"))
    assert _bench(monkeypatch, "draws", "--json", kept, "--markdown", first) == 0
    monkeypatch.setattr(_Fake, "run", None)
    monkeypatch.setattr(command, "results_type", lambda benchmark: Draws)
    assert _bench(monkeypatch, "draws", "--from-json", kept, "--markdown", again) == 0
    assert first.read_text() == again.read_text()
    assert _bench(monkeypatch, "lots", "--from-json", kept) == 2


@pytest.mark.parametrize(
    "results", [{"draw": 0.5}, {"draw": "x", "tasks": 2}, {"draw": 0.5, "tasks": 2, "more": 1}]
)
def test_a_report_of_other_results_is_refused(tmp_path: Path, results: dict[str, object]) -> None:
    from benchmarks.harness.report import make_report
    from benchmarks.harness.results import to_json

    path = tmp_path / "r.json"
    report = make_report("draws", results, quick=False, seed=0, duration=1.0)
    path.write_text(json.dumps(to_json(report)))
    with pytest.raises(InputError):
        load_report(path, Draws)


@pytest.mark.usefixtures("fake")
def test_unwritable_report_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench(monkeypatch, "draws", "--json", tmp_path) == 2
    assert "| 40 |" in capsys.readouterr().out  # results are not lost


def test_unknown_name_lists_the_names(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench(monkeypatch, "drawers") == 2
    assert "analysis, calibration" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(registry.MODULES))
def test_every_benchmark_has_the_face(name: str) -> None:
    benchmark = registry.find(name)
    assert list(inspect.signature(benchmark.run).parameters) == ["quick", "seed", "progress"]
    assert list(inspect.signature(benchmark.table).parameters) == ["results"]
