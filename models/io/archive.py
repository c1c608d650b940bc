"""Arrays and a JSON header in one `.npz`: the file format of the value types. Pickle is refused.

Reading is bounded beforehand: members by name, their size by the archive's directory and by their
array headers.
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
from unwrinkle.models.io.files import atomic_path

_HEADER = "header"
_SUFFIX = ".npy"
#: First bytes of every zip archive that is not empty.
_ZIP = b"PK\x03\x04"
#: First bytes of a single array.
_BARE = b"\x93NUM"
#: Size limit of all members that are read, together, bytes.
MOST_BYTES = 1 << 30
#: Size limit of the JSON header, bytes; NumPy stores four for a character.
MOST_HEADER = 16 << 20

#: Exceptions of zipfile, zlib, lzma and NumPy for damaged archives; RuntimeError also for encrypted
#: members and unknown compressions, SyntaxError and TokenError for an array header that is no
#: Python literal.
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


class _PickledError(ValueError):
    """A member holds Python objects, which only pickle could read."""


def save_archive(
    path: str | Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write `arrays` and the JSON-able `header` to `path`, atomically.

    Raises:
        InputError: the file cannot be written there.
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
    """Read a file that `save_archive` wrote; the header is {} for a plain `.npz` without one.

    Args:
        path: of the file.
        members: regular expression of the array names that the format has; other arrays are not
            read.
        most_bytes: size limit of all arrays that are read, together.

    Raises:
        InputError: the file is missing, truncated, damaged, encrypted, too large, not an `.npz`,
            has two members of one name, holds pickled objects, or its header holds a number that is
            not finite.
    """
    path = Path(path)
    if path.is_dir():
        inside = ", ".join(sorted(each.name for each in path.glob("*.npz"))[:4])
        raise InputError(f"{path}: is a folder; name a file in it ({inside or 'it has no .npz'})")
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
        reason = "holds pickled objects" if isinstance(error, _PickledError) else "damaged"
        raise InputError(
            f"{path}: cannot be read as .npz ({reason} or truncated); copy or record it again"
        ) from None
    return _header(path, arrays.pop(_HEADER, None)), arrays


def archive_members(path: str | Path) -> list[str]:
    """Return the names of the arrays in an archive without reading them.

    Raises:
        InputError: the file is no archive.
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
    """Read the arrays of an archive whose names match `wanted`, and its header."""
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
                f"{path}: holds {total / 1e6:.0f} MB or more, at most {most_bytes / 1e6:.0f} MB "
                "are read; the file is of another kind, or damaged"
            )
    return {name: _array(archive, item) for name, item in chosen.items()}


def _array(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one member after checking that its array header fits the bytes of the member.

    Raises:
        ValueError: it does not fit, or holds Python objects.
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
            raise _PickledError
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
