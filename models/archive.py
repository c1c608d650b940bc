"""Arrays plus a JSON header in one `.npz`: how value types save and load. Pickle is refused.

What is read is bounded before it is read: members by name, their size by the archive's own list and by their array headers.
"""

import json
import lzma
import math
import re
import struct
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
_SUFFIX = ".npy"
#: First bytes of every zip archive that holds something.
_ZIP = b"PK\x03\x04"
#: And of a single array.
_BARE = b"\x93NUM"
#: Of all members that are read together, bytes.
MOST_BYTES = 1 << 30
#: Of the JSON header alone, bytes; NumPy stores four for a character.
MOST_HEADER = 16 << 20

#: What zipfile, zlib, lzma and NumPy raise over damaged archives; RuntimeError also for encrypted members and unknown
#: compressions, SyntaxError and TokenError over an array header that is no Python literal.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    tokenize.TokenError,
    EOFError,
    KeyError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
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


def load_archive(
    path: str | Path, members: str = r".*", most_bytes: int = MOST_BYTES
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read what `save_archive` wrote; the header is {} for a plain `.npz` without one.

    Args:
        path: of the file.
        members: regular expression of the arrays that the format has; others are left unread.
        most_bytes: of all arrays that are read, together.

    Raises:
        InputError: missing, truncated, damaged, encrypted, too large, not an `.npz`, two members of one name, it holds
            pickled objects, or its header holds a number that is not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the name or the folder")
    try:
        with path.open("rb") as stream:
            begin = stream.read(len(_ZIP))
            if begin == _BARE:
                raise InputError(f"{path}: is a bare array, not an .npz archive")
            if begin != _ZIP:
                raise InputError(
                    f"{path}: cannot be read as .npz; check the name, or copy it again"
                )
            stream.seek(0)
            with zipfile.ZipFile(stream) as archive:
                arrays = _members(path, archive, re.compile(members), most_bytes)
    except _DAMAGED as error:
        reason = "holds pickled objects" if "allow_pickle" in str(error) else "damaged"
        raise InputError(
            f"{path}: cannot be read as .npz ({reason} or truncated); copy or record it again"
        ) from None
    return _header(path, arrays.pop(_HEADER, None)), arrays


def archive_members(path: str | Path) -> list[str]:
    """Names of the arrays in an archive, none of which is read.

    Raises:
        InputError: it is no archive.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(_SUFFIX) for name in archive.namelist()]
    except _DAMAGED as error:
        raise InputError(f"{path}: cannot be read as .npz ({error}); copy it again") from None
    return [name for name in names if name != _HEADER]


def _members(
    path: Path, archive: zipfile.ZipFile, wanted: "re.Pattern[str]", most_bytes: int
) -> dict[str, NDArray[Any]]:
    """The arrays of an archive that are wanted, and its header."""
    chosen: dict[str, zipfile.ZipInfo] = {}
    total = 0
    for item in archive.infolist():
        name = item.filename.removesuffix(_SUFFIX)
        if name != _HEADER and not wanted.fullmatch(name):
            continue
        if name in chosen:
            raise InputError(f"{path}: holds two members '{name}'; record it again")
        chosen[name] = item
        total += item.file_size
        if total > most_bytes or (name == _HEADER and item.file_size > MOST_HEADER):
            raise InputError(
                f"{path}: holds {total / 1e6:.0f} MB or more, at most {most_bytes / 1e6:.0f} MB are read; it is no "
                "such file, or damaged"
            )
    return {name: _array(archive, item) for name, item in chosen.items()}


def _array(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> NDArray[Any]:
    """One member, once its array header has been found to fit the bytes that are there.

    Raises:
        ValueError: it does not fit.
    """
    with archive.open(item) as stream:
        version = np.lib.format.read_magic(stream)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if read is None:
            raise ValueError(f"array format {version} is unknown")
        shape, _, dtype = read(stream)
        if dtype.hasobject:
            raise ValueError("objects need allow_pickle")
        if any(n < 0 for n in shape) or math.prod(shape) * dtype.itemsize > item.file_size:
            raise ValueError("the array is larger than its member")
    with archive.open(item) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


def _header(path: Path, text: NDArray[Any] | None) -> dict[str, Any]:
    if text is None:
        return {}
    try:
        header = json.loads(str(text), parse_constant=_refused, parse_float=_finite)
    except (ValueError, RecursionError):
        raise InputError(f"{path}: its JSON header is damaged; record it again") from None
    if not isinstance(header, dict):
        raise InputError(f"{path}: its JSON header is no object; record it again")
    return header


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no number")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _refused(text)
