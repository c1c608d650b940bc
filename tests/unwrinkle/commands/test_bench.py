"""Common interface of all benchmarks."""

import inspect
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.benchmarks.report import Progress
from unwrinkle.commands import bench


class _Fake(ModuleType):
    """A benchmark that draws one number."""

    def run(self, *, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
        progress(1, 2, "drawing")
        progress(2, 2, "drawing")
        return {"draw": np.random.default_rng(seed).uniform(), "tasks": 2 if quick else 40}

    def table(self, results: dict[str, Any]) -> str:
        return f"| tasks |\n|---|\n| {results['tasks']} |"


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "_find", lambda name: _Fake(name))


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
        reports.append(json.loads((tmp_path / name).read_text()))
    first, second = reports
    assert first["results"] == second["results"]
    assert first["results"]["tasks"] == 40
    assert (first["seed"], first["quick"]) == (3, False)
    assert first["command"] == "unwrinkle bench draws --seed 3"
    assert set(first["machine"]) == {"cpu", "cores", "memory", "system", "python"}
    assert first["machine"]["cores"] >= 1
    assert first["machine"]["memory"] > 2**28
    named = {"unwrinkle", "drake", "numpy", "scipy", "opencv", "toppra", "ruckig"}
    assert all(first["versions"][name] for name in named)


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
def test_unwritable_report_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bench(monkeypatch, "draws", "--json", tmp_path) == 2
    captured = capsys.readouterr()
    assert "| 40 |" in captured.out  # results are not lost
    assert "cannot write" in captured.err


def test_unknown_name_lists_the_names(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "benchmark_names", lambda: ["analysis", "plans"])
    assert _bench(monkeypatch, "drawers") == 2
    error = capsys.readouterr().err
    assert error == "unwrinkle: there is no benchmark 'drawers'; known are analysis, plans\n"


def test_every_benchmark_has_the_face() -> None:
    for name in bench.benchmark_names():
        benchmark = bench._find(name)
        assert list(inspect.signature(benchmark.run).parameters) == ["quick", "seed", "progress"]
        assert list(inspect.signature(benchmark.table).parameters) == ["results"]
