"""Digests of kept trials: the imported code, and the versions of what computes."""

from pathlib import Path

import pytest

from benchmarks.harness import digest
from benchmarks.harness.digest import code_digest, computing_versions, source_digest
from unwrinkle.models.errors import InputError


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of a module `probe_digest` that imports from both packages."""
    path = tmp_path / "probe_digest.py"
    path.write_text(
        "import json\nfrom benchmarks.harness import statistics\n\n\n"
        "def work():\n    from unwrinkle.models.table import Table\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    _forget()
    return path


def _forget() -> None:
    digest._closure_digest.cache_clear()
    digest._file.cache_clear()


def _with_other(monkeypatch: pytest.MonkeyPatch, name: str, folder: Path) -> str:
    """Return the digest of `probe_digest` if the file of a module were another."""
    found = digest._file
    other = folder / "other.py"
    file = found(name)
    assert file is not None
    other.write_text(file.read_text() + "\nOTHER = 1\n")
    with monkeypatch.context() as patch:
        patch.setattr(digest, "_file", lambda each: other if each == name else found(each))
        digest._closure_digest.cache_clear()
        changed = code_digest("probe_digest")
    digest._closure_digest.cache_clear()
    return changed


@pytest.mark.parametrize(
    "name", ["probe_digest", "benchmarks.harness.statistics", "unwrinkle.models.table"]
)
def test_it_covers_what_is_imported_from_both_packages(
    module: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    before = code_digest("probe_digest")
    assert len(before) == 64 and before == code_digest("probe_digest")
    assert _with_other(monkeypatch, name, tmp_path) != before


def test_it_does_not_cover_what_is_not_imported(
    module: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = code_digest("probe_digest")
    assert _with_other(monkeypatch, "unwrinkle.planning.plan", tmp_path) == before


@pytest.mark.parametrize("name", ["python", *digest.COMPUTING])
def test_another_version_of_what_computes_gives_another_digest(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    known = computing_versions()
    assert name in known
    before = code_digest("benchmarks.harness.statistics"), source_digest()
    monkeypatch.setattr(digest, "computing_versions", lambda: {**known, name: "99.0"})
    after = code_digest("benchmarks.harness.statistics"), source_digest()
    assert before[0] != after[0] and before[1] != after[1]


def test_a_module_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError):
        code_digest("benchmarks.nothing")
