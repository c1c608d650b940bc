"""Typed access to the fields of a JSON object; a field of another type is refused by name."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from unwrinkle.models.errors import InputError


def field(data: Any, key: str, where: str = "") -> Any:
    """Return the value of a key.

    Raises:
        InputError: `data` is no object, or lacks the key.
    """
    if not isinstance(data, Mapping):
        raise InputError(
            f"{where or 'the header'} is {_short(data)}, expected an object with '{key}'"
        )
    if key not in data:
        raise InputError(f"{_named(key, where)} is missing")
    return data[key]


def number(data: Any, key: str, where: str = "") -> float:
    """Return a finite number.

    Raises:
        InputError: the field is missing, or no finite number.
    """
    return as_number(field(data, key, where), _named(key, where))


def as_number(value: Any, name: str) -> float:
    """Convert a value to a finite number; `name` is for the message.

    Raises:
        InputError: it is no finite number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} is {_short(value)}, expected a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{name} is {_short(value)}, expected a finite number")
    return result


def integer(data: Any, key: str, where: str = "") -> int:
    """Return an integer that is written as one.

    Raises:
        InputError: the field is missing, or no integer.
    """
    value = field(data, key, where)
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{_named(key, where)} is {_short(value)}, expected a whole number")
    return value


def text(data: Any, key: str, where: str = "") -> str:
    """Return a string.

    Raises:
        InputError: the field is missing, or no string.
    """
    value = field(data, key, where)
    if not isinstance(value, str):
        raise InputError(f"{_named(key, where)} is {_short(value)}, expected a text")
    return value


def items(data: Any, key: str, where: str = "", count: int | None = None) -> Sequence[Any]:
    """Return a list, of length `count` if given.

    Raises:
        InputError: the field is missing, no list, or of another length.
    """
    value = field(data, key, where)
    if not isinstance(value, list) or (count is not None and len(value) != count):
        wanted = "a list" if count is None else f"a list of {count}"
        raise InputError(f"{_named(key, where)} is {_short(value)}, expected {wanted}")
    return value


def flags(data: Any, key: str, where: str = "", *, count: int) -> tuple[bool, ...]:
    """Return a list of `count` booleans.

    Raises:
        InputError: the field is missing, or no such list.
    """
    values = items(data, key, where, count)
    if not all(isinstance(value, bool) for value in values):
        raise InputError(f"{_named(key, where)} is {_short(values)}, expected true or false")
    return tuple(values)


def only(data: Any, keys: Sequence[str], where: str) -> None:
    """Refuse unknown keys.

    Raises:
        InputError: `data` is no object, or has a key that is not in `keys`.
    """
    unknown = sorted(set(data) - set(keys)) if isinstance(data, Mapping) else [_short(data)]
    if unknown:
        raise InputError(f"{where} has unknown fields {', '.join(map(str, unknown))}")


def _named(key: str, where: str) -> str:
    return f"{where}.{key}" if where else key


def _short(value: Any) -> str:
    shown = repr(value) if not isinstance(value, list | dict) else type(value).__name__
    if isinstance(value, int | float):
        shown = f"{value:.3g}" if abs(value) < 1e300 else "a huge number"
    return shown if len(shown) <= 40 else shown[:37] + "..."
