"""The command of the benchmarks, and what all benchmarks have in common."""

import sys
from pathlib import Path

import pytest

from unwrinkle import cli
from unwrinkle.commands import bench


def _bench(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_without_a_checkout_it_says_where_the_benchmarks_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "__file__", str(tmp_path / "unwrinkle" / "commands" / "bench.py"))
    monkeypatch.chdir(tmp_path)
    assert bench.checkout() is None
    assert _bench(monkeypatch, "plans") == 2
    assert "checkout" in capsys.readouterr().err


def test_the_current_folder_is_a_checkout(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "__file__", "/nowhere/unwrinkle/commands/bench.py")
    monkeypatch.chdir(repository)
    assert bench.checkout() == repository
