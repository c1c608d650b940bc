"""Trials: kept one by one, resumed, and only for the very code and settings."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.harness.trials import FailedTrial, KeptTrial, Trial, run_trials, try_trials
from unwrinkle.models.errors import InputError

_WORK = """
from pathlib import Path

def work(settings, folder):
    with Path(settings["calls"]).open("a") as calls:
        calls.write(settings["name"])
    if Path(settings["fails"]).exists() and settings["name"] == "b":
        raise ValueError("no such wrinkle")
    (folder / "kept.txt").write_text("kept")
    return {"twice": 2 * settings["value"]}
"""


@pytest.fixture
def rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Trial]:
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "probe_work.py").write_text(_WORK)
    monkeypatch.syspath_prepend(str(tmp_path / "code"))
    monkeypatch.chdir(tmp_path)
    common = {"calls": str(tmp_path / "calls"), "fails": str(tmp_path / "fails")}
    return [
        Trial(name, "probe_work:work", {"name": name, "value": value, **common})
        for value, name in enumerate("abc")
    ]


@dataclass(frozen=True, kw_only=True)
class Kept(KeptTrial):
    twice: int


class Told:
    """What the progress was told."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, int]] = []

    def __call__(self, done: int, total: int, stage: str) -> None:
        self.calls.append((done, total))


def test_an_interrupted_run_resumes(rows: list[Trial], tmp_path: Path) -> None:
    (tmp_path / "fails").touch()
    with pytest.raises(InputError, match="b: ValueError: no such"):
        run_trials("probe", rows, Kept, Told(), workers=1)
    kept = try_trials("probe", rows, Kept, Told(), workers=1, tolerated="ValueError")
    assert [isinstance(each, FailedTrial) for each in kept] == [False, True, False]
    assert isinstance(kept[1], FailedTrial) and kept[1].reason == "ValueError: no such wrinkle"
    (tmp_path / "fails").unlink()
    told = Told()
    done = run_trials("probe", rows, Kept, told, workers=1)
    assert [row.twice for row in done] == [0, 2, 4]
    assert [row.name for row in done] == ["a", "b", "c"]
    assert sorted((tmp_path / "calls").read_text()) == ["a", "b", "b", "b", "c"]
    assert told.calls == [(2, 3), (3, 3)]
    assert all((Path(row.folder) / "kept.txt").exists() for row in done)


def test_other_settings_and_other_benchmarks_have_other_places(rows: list[Trial]) -> None:
    other = Trial(rows[0].name, rows[0].work, {**rows[0].settings, "value": 9})
    assert rows[0].folder("probe") != other.folder("probe")
    assert rows[0].folder("probe") != rows[0].folder("another")


def test_more_rows_than_processes_may_serve_come_to_an_end(rows: list[Trial]) -> None:
    many = [
        Trial(f"row-{k}", rows[0].work, {**rows[0].settings, "name": "m", "value": k})
        for k in range(7)
    ]
    done = run_trials("many", many, Kept, Told(), workers=2)
    assert [row.twice for row in done] == [2 * k for k in range(7)]


def test_a_process_that_dies_is_a_row_that_failed(
    rows: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "code" / "deadly_work.py").write_text(
        "import os\n\ndef work(settings, folder):\n    os._exit(9)\n"
    )
    row = Trial("gone", "deadly_work:work", {})
    with pytest.raises(InputError, match="gone: its process died"):
        run_trials("probe", [row, rows[0]], Kept, Told(), workers=1)
    assert (rows[0].folder("probe") / "trial.json").exists()
