"""Typed YAML: a dataclass is the schema; unknown keys are refused."""

import dataclasses
import datetime
import difflib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml

from unwrinkle.models.errors import InputError

Schema = TypeVar("Schema")

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
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name or the folder") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error})") from None
    if not text.strip():
        raise InputError(f"{path}: is empty; write at least one key")
    try:
        mirror = _mutable(schema)
        loaded: Any = yaml_load_typed(schema=mirror, data=text, child_name=child)
    except _UNFIT as error:
        reason = (
            _unknown_key(mirror, text, child) or f"{_one_line(error)}{_where(mirror, text, child)}"
        )
        raise InputError(f"{path}: {reason}") from None
    try:
        return cast(Schema, _rebuilt(schema, loaded))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


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
    return " ".join(str(error).split()).replace("<string>:", "").strip() or type(error).__name__


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


def _where(schema: type[Any], text: str, child: str | None) -> str:
    """Name the keys whose values do not fit the schema, for the end of a message.

    Empty where there are none.
    """
    keys = _unfit_keys(schema, _mapping(text, child))
    hint = (
        "; put it in quotes" if any(isinstance(value, datetime.date) for _, value in keys) else ""
    )
    return f" (key {', '.join(name for name, _ in keys)}{hint})" if keys else ""


def _unfit_keys(schema: Any, raw: Any) -> list[tuple[str, Any]]:
    """Find the keys (dotted) and values of a mapping that the schema refuses, by loading each on
    its own.
    """
    from pydrake.common.yaml import yaml_load_typed

    if not (isinstance(raw, dict) and dataclasses.is_dataclass(schema)):
        return []
    hints = get_type_hints(schema)
    found = []
    for key, value in raw.items():
        try:
            yaml_load_typed(schema=schema, data=yaml.safe_dump({key: value}))
        except _UNFIT:
            inner = _unfit_keys(hints.get(str(key)), value)
            found += [(f"{key}.{name}", item) for name, item in inner] or [(str(key), value)]
    return found
