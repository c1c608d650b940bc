"""Files are written whole or not at all."""

import errno
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive
from unwrinkle.models.io.files import atomic_path, write_json, write_text


def test_text_replaces_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "new" / "page.md"
    write_text(path, "old")
    write_text(path, "Länge")
    assert path.read_text(encoding="utf-8") == "Länge"
    assert list(path.parent.iterdir()) == [path]


def test_a_failing_body_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_numpy_archive_keeps_its_suffix(tmp_path: Path) -> None:
    path = tmp_path / "plan.npz"
    with atomic_path(path) as temporary:
        np.savez(temporary, q=np.arange(3))
    with np.load(path) as archive:
        np.testing.assert_array_equal(archive["q"], [0, 1, 2])
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_place_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        write_text(tmp_path / "file" / "page.md", "x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot write"):
        write_text(tmp_path / "folder", "x")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_errors_of_the_body_about_other_files_are_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    with pytest.raises(FileNotFoundError) as caught, atomic_path(path):
        (tmp_path / "picture.png").read_bytes()
    assert caught.value.filename == str(tmp_path / "picture.png")
    with pytest.raises(ConnectionError), atomic_path(path):
        raise ConnectionError("peer")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_named_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    with pytest.raises(InputError, match=r"page\.md"), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_json_takes_numpy(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    write_json(path, {"a": np.float64(0.5), "n": np.int64(3), "q": np.eye(2), "s": ["x", None]})
    expected = {"a": 0.5, "n": 3, "q": [[1.0, 0.0], [0.0, 1.0]], "s": ["x", None]}
    assert json.loads(path.read_text()) == expected


@pytest.mark.parametrize("value", [float("nan"), np.float64("inf"), np.array([1.0, np.nan])])
def test_json_refuses_nan(value: object, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "r.json", {"a": value})
    assert list(tmp_path.iterdir()) == []


def test_json_refuses_what_has_no_form(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="object has no form in JSON"):
        write_json(tmp_path / "r.json", {"a": object()})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("header", [b"{'descr': '<f8', (", b"{'descr': \x00}", b"[[["])
def test_an_archive_with_a_damaged_array_header_is_refused(tmp_path: Path, header: bytes) -> None:
    """NumPy reads old headers as Python, and what is none raised errors of the tokenizer."""
    text = header.ljust(117) + b"\n"
    member = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
    path = tmp_path / "plan.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("times.npy", member)
    with pytest.raises(InputError, match=r"plan\.npz: cannot be read"):
        load_archive(path)
