"""Atomic writing of files: a temporary file beside the target, then a rename."""

import errno
import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from unwrinkle.models.errors import InputError

#: Errors of a write that carry no file name: the disk, the quota or the largest file size is
#: exhausted.
_EXHAUSTED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, and rename it to `path` when the body succeeds.

    The temporary file has the same suffix (NumPy and matplotlib choose formats by it). When the
    body raises, the temporary file is removed and `path` is left unchanged. Missing parent folders
    are made. Errors of the body that are not about the temporary file are passed on unchanged.

    Args:
        path: of the finished file.

    Raises:
        InputError: the folder cannot be made, or the file cannot be written or renamed there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        with _writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
        except OSError as error:
            if error.errno not in _EXHAUSTED and error.filename not in (temporary, str(temporary)):
                raise
            with _writing(path):
                raise
        with _writing(path):
            temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}; name a writable file") from error


def write_text(path: str | Path, text: str) -> None:
    """Write `text` to `path` as UTF-8, atomically.

    Raises:
        InputError: the file cannot be written there.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: Any) -> None:
    """Write `value` to `path` as indented JSON, atomically.

    NumPy scalars and arrays become numbers and nested lists.

    Raises:
        InputError: the file cannot be written there.
        ValueError: a number is NaN or infinite, which JSON does not have.
        TypeError: a value has no form in JSON.
    """
    write_text(path, json.dumps(value, indent=2, allow_nan=False, default=_plain) + "\n")


def _plain(value: Any) -> Any:
    """Convert NumPy scalars and arrays to plain numbers and lists (without importing NumPy)."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")
