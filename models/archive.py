"""Arrays plus a JSON header in one `.npz`: how value types save and load. Pickle is refused."""

import json
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.files import atomic_path

_HEADER = "header"


#: What NumPy raises over damaged archives; the last two over a header that is no Python literal any more.
_DAMAGED = (
    zipfile.BadZipFile,
    EOFError,
    OSError,
    ValueError,
    KeyError,
    zlib.error,
    SyntaxError,
    tokenize.TokenError,
)


def save_archive(
    path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write `arrays` and the JSON-able `header` to `path`, whole or not at all.

    Raises:
        InputError: it cannot be written there.
    """
    path = Path(path)
    text = json.dumps(dict(header), allow_nan=False)
    stored: dict[str, Any] = dict(arrays)
    stored[_HEADER] = np.array(text)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **stored)


def load_archive(path: str | Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read what `save_archive` wrote; the header is {} for a plain `.npz` without one.

    Raises:
        InputError: missing, truncated, not an `.npz`, or it holds pickled objects.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the name or the folder")
    try:
        # NumPy leaves the file open when it cannot read it: so it is opened, and closed, here.
        with path.open("rb") as stream:
            stored = np.load(stream, allow_pickle=False)
            if not isinstance(stored, np.lib.npyio.NpzFile):
                raise InputError(f"{path}: is a bare array, not an .npz archive")
            arrays = {key: stored[key] for key in stored.files}
    except _DAMAGED as error:
        reason = "holds pickled objects" if "pickle" in str(error).lower() else "damaged"
        raise InputError(
            f"{path}: cannot be read as .npz ({reason} or truncated); copy or record it again"
        ) from None
    header: dict[str, Any] = {}
    if _HEADER in arrays:
        try:
            header = json.loads(str(arrays.pop(_HEADER)))
        except json.JSONDecodeError:
            raise InputError(f"{path}: its JSON header is damaged; record it again") from None
        if not isinstance(header, dict):
            raise InputError(f"{path}: its JSON header is no object; record it again")
    return header, arrays
