"""The summary of the published experiments, from reports."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.published.summary import BEGIN, BENCHMARKS, END, summary, with_summary
from unwrinkle.models.errors import InputError


@pytest.mark.parametrize("name", ["grasps"])
def test_a_quick_or_a_missing_run_is_no_result(
    name: str, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.published.summary.BENCHMARKS", {name: BENCHMARKS[name]})
    shutil.copy(repository / "docs" / "results" / f"{name}.json", tmp_path)
    assert f"| [{name}]({name}.md) |" in summary(tmp_path)
    path = tmp_path / f"{name}.json"
    report = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**report, "quick": True}), encoding="utf-8")
    with pytest.raises(InputError):
        summary(tmp_path)
    path.unlink()
    with pytest.raises(InputError):
        summary(tmp_path)


def test_only_what_is_between_the_marks_changes() -> None:
    page = f"# Results\n{BEGIN}\nold\n{END}\nmore\n"
    assert with_summary(page, "| new |") == f"# Results\n{BEGIN}\n| new |\n{END}\nmore\n"
    with pytest.raises(InputError):
        with_summary("# Results\n", "| new |")
