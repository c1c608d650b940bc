"""The check of kept results sees a page that is not its report's."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.harness.check import problems


@pytest.fixture
def kept(repository: Path, tmp_path: Path) -> Path:
    for kind in ("json", "md"):
        shutil.copy(repository / "docs" / "results" / f"wrinkledness.{kind}", tmp_path)
    return tmp_path


def test_a_page_of_its_report_has_no_problem(kept: Path) -> None:
    assert problems(kept, "wrinkledness") == []


def test_a_changed_figure_is_seen(kept: Path) -> None:
    path = kept / "wrinkledness.json"
    report = json.loads(path.read_text())
    report["results"]["sizes"][0]["bins_used"] += 1
    path.write_text(json.dumps(report))
    assert len(problems(kept, "wrinkledness")) == 1
    report["quick"] = True
    path.write_text(json.dumps(report))
    assert len(problems(kept, "wrinkledness")) == 2


def test_a_report_that_cannot_be_loaded_is_a_problem(kept: Path) -> None:
    (kept / "wrinkledness.json").write_text("{}")
    assert len(problems(kept, "wrinkledness")) == 1
