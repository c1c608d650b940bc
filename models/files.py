"""Whole files or none: everything the project writes goes through a temporary file and a rename."""

import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from unwrinkle.models.errors import InputError


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, which takes its place when the body ends well.

    The temporary file has the same suffix (NumPy and matplotlib choose formats by it). When the
    body raises, the temporary file is removed and `path` is left as it was. Missing parent folders
    are made.

    Args:
        path: where the finished file goes.

    Raises:
        InputError: if the file cannot be written there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}; name a writable file") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_text(path: str | Path, text: str) -> None:
    """Write `text` to `path` as UTF-8, whole or not at all.

    Raises:
        InputError: if the file cannot be written there.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: Any) -> None:
    """Write `value` to `path` as indented JSON, whole or not at all.

    NumPy scalars and arrays become numbers and nested lists.

    Raises:
        InputError: if the file cannot be written there.
        ValueError: if a number is NaN or infinite, which JSON does not have.
        TypeError: if something in `value` has no form in JSON.
    """
    write_text(path, json.dumps(value, indent=2, allow_nan=False, default=_plain) + "\n")


def _plain(value: Any) -> Any:
    """Turn NumPy scalars and arrays into what `json` knows, without needing NumPy here."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")
