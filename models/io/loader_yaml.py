"""Typed YAML: a dataclass is the schema; unknown keys and keys given twice are refused."""

import dataclasses
import datetime
import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml

from unwrinkle.models.errors import InputError

Schema = TypeVar("Schema")

#: Types in the loader's messages, in words.
_PLAIN = {"bool": "true-or-false", "int": "whole-number", "float": "number", "str": "text"}

#: What the typed loader raises over a text that is no YAML or does not fit the schema.
_UNFIT = (yaml.YAMLError, RuntimeError, ValueError, TypeError, LookupError, OSError)


def models_dir() -> Path:
    """Return the folder of the package's model data."""
    return Path(__file__).resolve().parents[1] / "data"


def load_yaml(path: str | Path, schema: type[Schema], *, child: str | None = None) -> Schema:
    """Read a YAML file into the dataclass `schema`.

    Unknown keys are refused; keys the schema has defaults for may be left out. Every field of the
    schema needs a default. With `child`, the value under that key of the document's root is read
    instead.

    Raises:
        InputError: the file is missing, is no YAML, or does not fit the schema; the message names
            the file and the key.
    """
    from pydrake.common.yaml import (
        yaml_load_typed,  # imported here: slow, and `--help` does not need it
    )

    path = Path(path)
    text = read_text(path)
    if not text.strip():
        raise InputError(f"{path}: is empty; write at least one key")
    refuse_repeated_keys(text, path)
    try:
        mirror = _mutable(schema)
        loaded: Any = yaml_load_typed(schema=mirror, data=text, child_name=child)
    except _UNFIT as error:
        reason = (
            _unknown_key(mirror, text, child)
            or _unquoted(mirror, text, child)
            or f"{_one_line(error)}{_where(mirror, text, child)}"
        )
        raise InputError(f"{path}: {reason}") from None
    try:
        return cast(Schema, _rebuilt(schema, loaded))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_text(path: Path) -> str:
    """Read a text file in UTF-8.

    Raises:
        InputError: it is missing, or no such text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name or the folder") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from None


def refuse_repeated_keys(text: str, path: Path) -> None:
    """Refuse a YAML text with a key that is given twice in one mapping.

    YAML keeps the last value without a word, so that a site would run with a speed that its reader
    has crossed out. A text that is no YAML passes; reading it names the line.

    Args:
        text: of the file.
        path: of the file, for messages.

    Raises:
        InputError: such a key; the message names it and both lines.
    """
    try:
        documents = list(yaml.compose_all(text, yaml.SafeLoader))
    except yaml.YAMLError:
        return
    for place, first, second in _repeated(documents):
        raise InputError(
            f"{path}: key '{place}' is given twice, at lines {first} and {second}; keep one"
        )


def _repeated(nodes: Iterable[Any], prefix: str = "") -> Iterator[tuple[str, int, int]]:
    """Yield the dotted name and the two lines of each key that stands twice in one mapping."""
    for node in nodes:
        if isinstance(node, yaml.SequenceNode):
            yield from _repeated(node.value, prefix)
        if not isinstance(node, yaml.MappingNode):
            continue
        lines: dict[str, int] = {}
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode) and name in lines:
                yield f"{prefix}{name}", lines[name], line
            lines[name] = line
            yield from _repeated([value], f"{prefix}{name}.")


def _frozen(schema: Any) -> bool:
    parameters = getattr(schema, "__dataclass_params__", None)
    return parameters is not None and parameters.frozen


def _mutable(schema: type[Any]) -> type[Any]:
    """Return a mutable copy of a frozen dataclass type, nested types included.

    The typed loader assigns to fields.
    """
    if get_origin(schema) is list:
        (item,) = get_args(schema)
        twin: Any = _mutable(item)
        return schema if twin is item else list[twin]
    if not _frozen(schema):
        return schema
    hints = get_type_hints(schema)
    twins: list[tuple[str, Any, Any]] = []
    for field in dataclasses.fields(schema):
        hint = _mutable(hints[field.name])
        if hint is not hints[field.name]:
            value = dataclasses.field(default_factory=hint)
        elif field.default_factory is not dataclasses.MISSING:
            value = dataclasses.field(default_factory=field.default_factory)
        else:
            value = dataclasses.field(default=field.default)
        twins.append((field.name, hint, value))
    return dataclasses.make_dataclass(schema.__name__, twins)


def _rebuilt(schema: Any, loaded: Any) -> Any:
    """Convert an instance of the mutable copy back to the frozen dataclass."""
    if get_origin(schema) is list:
        return [_rebuilt(get_args(schema)[0], item) for item in loaded]
    if not _frozen(schema):
        return loaded
    hints = get_type_hints(schema)
    return schema(**{name: _rebuilt(hint, getattr(loaded, name)) for name, hint in hints.items()})


def _one_line(error: Exception) -> str:
    if isinstance(error, yaml.YAMLError):
        mark: Any = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        return f"is not valid YAML{where}"
    if isinstance(error, TypeError):
        return "a value has another form than the key wants, such as a number instead of a list"
    text = " ".join(str(error).split()).replace("<string>:", "").strip()
    for python, plain in _PLAIN.items():
        text = text.replace(f"<class '{python}'>", plain)
    return text or type(error).__name__


def _unknown_key(schema: type[Any], text: str, child: str | None) -> str:
    """Name the first key that the schema does not have, and the nearest ones that it has; empty if
    there is none.
    """
    raw = _mapping(text, child)
    unknown = next(_unknown_keys(schema, raw), None)
    if unknown is None:
        return ""
    prefix, key, known = unknown
    near = difflib.get_close_matches(key, known, 3)
    cure = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(known)}"
    return f"there is no key '{prefix}{key}'; {cure}"


def _unknown_keys(schema: Any, raw: Any, prefix: str = "") -> Iterator[tuple[str, str, list[str]]]:
    """Yield the place, the key, and the keys that there are instead."""
    if not (isinstance(raw, dict) and dataclasses.is_dataclass(schema)):
        return
    hints = get_type_hints(schema)
    for key, value in raw.items():
        if key in hints:
            yield from _unknown_keys(hints[key], value, f"{prefix}{key}.")
        else:
            yield prefix, str(key), list(hints)


def _mapping(text: str, child: str | None) -> Any:
    """Return the values of a YAML text, or of one key of it; None where it is no YAML."""
    try:
        raw = yaml.safe_load(text)
    except yaml.YAMLError:
        return None
    if child is not None:
        return raw.get(child) if isinstance(raw, dict) else None
    return raw


def _unquoted(schema: type[Any], text: str, child: str | None) -> str:
    """Name the first text that YAML reads as a truth value, a number or a date; empty if none."""
    for name, value, hint in _unfit_keys(schema, _mapping(text, child)):
        if hint is str and isinstance(value, bool | int | float | datetime.date):
            return (
                f"a text is wanted, and YAML reads {_KINDS[type(value)]}, {value}, where quotes "
                f"are missing (key {name}; put it in quotes)"
            )
    return ""


#: What YAML makes of a value without quotes.
_KINDS = {
    bool: "a truth value",
    int: "a number",
    float: "a number",
    datetime.date: "a date",
    datetime.datetime: "a date",
}


def _where(schema: type[Any], text: str, child: str | None) -> str:
    """Name the keys whose values do not fit the schema, for the end of a message.

    Empty where there are none.
    """
    keys = _unfit_keys(schema, _mapping(text, child))
    return f" (key {', '.join(name for name, _, _ in keys)})" if keys else ""


def _unfit_keys(schema: Any, raw: Any) -> list[tuple[str, Any, Any]]:
    """Find the keys (dotted), values and wanted types of a mapping that the schema refuses, by
    loading each on its own.
    """
    from pydrake.common.yaml import yaml_load_typed

    if not (isinstance(raw, dict) and dataclasses.is_dataclass(schema)):
        return []
    hints = get_type_hints(schema)
    found: list[tuple[str, Any, Any]] = []
    for key, value in raw.items():
        try:
            yaml_load_typed(schema=schema, data=yaml.safe_dump({key: value}))
        except _UNFIT:
            hint = hints.get(str(key))
            inner = _unfit_keys(hint, value)
            found += [(f"{key}.{name}", item, kind) for name, item, kind in inner] or [
                (str(key), value, hint)
            ]
    return found
