"""The boards at a glance: the committed page says what the committed reports say."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.published.summary import BEGIN, BOARDS, END, glance, with_glance
from unwrinkle.models.errors import InputError


def test_the_page_of_results_is_that_of_the_reports(repository: Path) -> None:
    folder = repository / "docs" / "results"
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert with_glance(page, glance(folder)) == page
    assert all((folder / f"{name}.{kind}").exists() for name in BOARDS for kind in ("md", "png"))


def test_a_quick_run_is_no_result(repository: Path, tmp_path: Path) -> None:
    for name in BOARDS:
        shutil.copy(repository / "docs" / "results" / f"{name}.json", tmp_path)
    path = tmp_path / "table2.json"
    report = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**report, "quick": True}), encoding="utf-8")
    with pytest.raises(InputError, match=r"table2\.json: is of a quick run, which is no result"):
        glance(tmp_path)
    path.unlink()
    with pytest.raises(InputError, match="run `unwrinkle bench table2 --json"):
        glance(tmp_path)


def test_only_what_is_between_the_marks_changes() -> None:
    page = f"# Results\n{BEGIN}\nold\n{END}\nmore\n"
    assert with_glance(page, "| new |") == f"# Results\n{BEGIN}\n| new |\n{END}\nmore\n"
    with pytest.raises(InputError, match="lacks"):
        with_glance("# Results\n", "| new |")
