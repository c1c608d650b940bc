"""Save results as JSON values, and build results from them."""

import dataclasses
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from unwrinkle.models.errors import InputError

T = TypeVar("T")


def to_json(value: Any) -> Any:
    """Return JSON values: objects for dataclasses and mappings, lists for sequences and arrays."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_json(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): to_json(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def from_json(kind: type[T], value: Any, where: str = "results") -> T:
    """Build a value of a type, nested dataclasses included, from what `to_json` returned.

    Args:
        kind: a dataclass, or any other type with hints.
        value: JSON values.
        where: named in an error.

    Raises:
        InputError: the values do not fit the type: a field lacks, is unknown, or of another type.
    """
    try:
        built = TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{where}: {place}: {first['msg']}; run the benchmark again") from None
    unknown = _unknown(value, to_json(built))
    if unknown:
        raise InputError(f"{where}: {unknown} is no field of it; run the benchmark again")
    return built


def _unknown(value: Any, built: Any, place: str = "") -> str:
    """Return the place of the first key that the built value lacks, or an empty text."""
    if isinstance(value, dict) and isinstance(built, dict):
        for key, each in value.items():
            below = f"{place}.{key}".lstrip(".")
            if str(key) not in built:
                return below
            if found := _unknown(each, built[str(key)], below):
                return found
    elif isinstance(value, list) and isinstance(built, list):
        for index, (each, other) in enumerate(zip(value, built, strict=True)):
            if found := _unknown(each, other, f"{place}.{index}".lstrip(".")):
                return found
    return ""
