"""Typed YAML: a dataclass is the schema, and an unknown key is an error."""

import dataclasses
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml

from unwrinkle.models.errors import InputError

Schema = TypeVar("Schema")


def models_dir() -> Path:
    """Return the folder of the package's model data."""
    return Path(__file__).resolve().parent / "data"


def load_yaml(path: str | Path, schema: type[Schema], *, child: str | None = None) -> Schema:
    """Read a YAML file into the dataclass `schema`.

    Unknown keys are refused; keys the schema has defaults for may be left out. Every field of the schema
    needs a default. With `child`, the value under that key of the document's root is read instead.

    Raises:
        InputError: the file is missing, is no YAML, or does not fit the schema; the message names
            the file and the key.
    """
    from pydrake.common.yaml import yaml_load_typed  # here: `--help` need not wait for Drake

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
    except (yaml.YAMLError, RuntimeError, ValueError, TypeError, LookupError, OSError) as error:
        raise InputError(f"{path}: {_one_line(error)}{_key(text, error)}") from None
    try:
        return cast(Schema, _rebuilt(schema, loaded))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _frozen(schema: Any) -> bool:
    parameters = getattr(schema, "__dataclass_params__", None)
    return parameters is not None and parameters.frozen


def _mutable(schema: type[Any]) -> type[Any]:
    """Return a twin of a frozen dataclass, mutable down to what it holds: the typed loader assigns."""
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
    """Return the frozen dataclass that a filled twin stands for."""
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
    text = " ".join(str(error).split())
    if "datetime.date" in text:
        text += "; put it in quotes"
    return text.replace("<string>:", "").strip() or type(error).__name__


def _key(text: str, error: Exception) -> str:
    """Name the top-level key whose value the conversion choked on, where the error does not."""
    if not str(error).startswith("could not convert"):
        return ""
    raw = yaml.safe_load(text)
    keys = [key for key, value in raw.items() if repr(value) in str(error)]
    return f" (key {', '.join(map(str, keys))})" if keys else ""
