"""Settings of a nested dataclass by dotted key: `loop.mode=paper` changes one, checked by its type.

The dataclass is the schema, as for a YAML file: a key that it does not have is refused, and so is
a value of another type.
"""

import dataclasses as dc
import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from unwrinkle.models.errors import InputError

Schema = TypeVar("Schema")

_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class UnknownSettingError(InputError):
    """A key that the schema does not have.

    Attributes:
        key: as given.
        near: keys that are spelt nearly so, nearest first; of a group, its keys.
    """

    def __init__(self, key: str, known: Sequence[str]) -> None:
        """Find the nearest known keys, and name them."""
        inside = [name for name in known if name.startswith(f"{key}.")]
        self.key = key
        self.near = tuple(inside or _nearest(key, known))
        if inside:
            text = f"'{key}' is a group of settings; give one of {', '.join(self.near)}"
        elif self.near:
            text = f"there is no setting '{key}'; did you mean {' or '.join(self.near)}?"
        else:
            text = f"there is no setting '{key}'; `unwrinkle config` lists all"
        super().__init__(text)


class SettingTypeError(InputError):
    """A value that is not of the setting's type.

    Attributes:
        key: of the setting.
        expected: type of the setting, in words.
    """

    def __init__(self, key: str, value: str, expected: str) -> None:
        """Name the setting and its type."""
        self.key, self.expected = key, expected
        super().__init__(f"setting {key} is {expected}, got '{value}'")


def setting_values(settings: Any, prefix: str = "") -> dict[str, Any]:
    """List the values of a dataclass and of the dataclasses in it by dotted key, in their order."""
    found: dict[str, Any] = {}
    for item in dc.fields(settings):
        value, key = getattr(settings, item.name), f"{prefix}{item.name}"
        found |= setting_values(value, f"{key}.") if dc.is_dataclass(value) else {key: value}
    return found


def with_settings(settings: Schema, assignments: Sequence[str]) -> Schema:
    """Return the dataclass with settings changed by texts `key=value`.

    Values are read as YAML: `speed=0.5`, `planner.turntable=fixed`, `garment_centre=[0.1, -1.1]`.

    Args:
        settings: nested dataclass, which is also the schema.
        assignments: texts; no key twice.

    Raises:
        UnknownSettingError: a key that the dataclass does not have.
        SettingTypeError: a value of another type.
        InputError: a text without `=`, or a key given twice.
    """
    known = list(setting_values(settings))
    given = assigned_keys(assignments)
    for text, key in zip(assignments, given, strict=True):
        if key not in known:
            raise UnknownSettingError(key, known)
        settings = _changed(settings, key.split("."), key, text.partition("=")[2].strip())
    return settings


def check_finite(settings: Any, what: str) -> None:
    """Refuse settings that hold a number that is not finite, on their own or in a list.

    Args:
        settings: nested dataclass.
        what: it is, for the message: `scenario` or `site`.

    Raises:
        InputError: such a number; the message names its key.
    """
    for key, value in setting_values(settings).items():
        for number in value if isinstance(value, list) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                raise InputError(f"{what}: {key} is {value}; give finite numbers")


def assigned_keys(assignments: Sequence[str]) -> list[str]:
    """Return the keys of texts `key=value`.

    Raises:
        InputError: a text without `=`, or a key given twice.
    """
    keys: list[str] = []
    for text in assignments:
        key, equals, _ = text.partition("=")
        key = key.strip()
        if not equals or not key:
            raise InputError(f"--set '{text}': give KEY=VALUE, e.g. loop.mode=paper")
        if key in keys:
            raise InputError(f"--set {key} is given twice; leave one out")
        keys.append(key)
    return keys


def settings_yaml(
    settings: Any, sources: Mapping[str, str], *, name: str | None = None, head: str = ""
) -> str:
    """Write a dataclass as YAML, each value with a comment on where it comes from.

    Args:
        settings: nested dataclass.
        sources: source by dotted key; keys left out are `default`.
        name: key that the whole document stands under; none if left out.
        head: comment above it, one line.
    """
    lines: list[tuple[str, str]] = []
    depth = 0
    if name is not None:
        lines.append((f"{_scalar(name)}:", ""))
        depth = 1
    _write(settings, sources, "", depth, lines)
    column = min(max(len(text) for text, _ in lines), 72) + 2
    body = [f"{text:{column}}# {source}" if source else text for text, source in lines]
    return "\n".join([*([f"# {head}"] if head else []), *body]) + "\n"


def _write(
    settings: Any,
    sources: Mapping[str, str],
    prefix: str,
    depth: int,
    lines: list[tuple[str, str]],
) -> None:
    for item in dc.fields(settings):
        value, key = getattr(settings, item.name), f"{prefix}{item.name}"
        indent = "  " * depth
        if dc.is_dataclass(value):
            lines.append((f"{indent}{item.name}:", ""))
            _write(value, sources, f"{key}.", depth + 1, lines)
        else:
            text = f"{indent}{item.name}: {_scalar(value)}"
            lines.append((text, sources.get(key, "default")))


def _scalar(value: Any) -> str:
    """Write a value as YAML in one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=1_000_000)
    return text.removesuffix("...\n").strip()


def _changed(settings: Any, names: list[str], key: str, text: str) -> Any:
    name, *inner = names
    if inner:
        value = _changed(getattr(settings, name), inner, key, text)
    else:
        value = _read(get_type_hints(type(settings))[name], key, text)
    return dc.replace(settings, **{name: value})


def _read(kind: Any, key: str, text: str) -> Any:
    """Read a value of a type from YAML.

    Raises:
        SettingTypeError: it is none of that type.
    """
    try:
        raw = yaml.safe_load(text)
        if kind is str and not isinstance(raw, str):
            raw = text  # 2013 is a text where a text is wanted
        return _converted(kind, raw)
    except (yaml.YAMLError, TypeError, ValueError, OverflowError):
        raise SettingTypeError(key, text, _described(kind)) from None


def _converted(kind: Any, raw: Any) -> Any:
    """Convert a YAML value to a type.

    Raises:
        TypeError: it is of another type.
        ValueError: it is a text that is no number.
    """
    if get_origin(kind) is list:
        (item,) = get_args(kind)
        if not isinstance(raw, list):
            raise TypeError
        return [_converted(item, value) for value in raw]
    if kind is float and isinstance(raw, int | float | str) and not isinstance(raw, bool):
        return float(raw)  # YAML 1.1 reads 1e-3 as a text
    if not isinstance(raw, kind) or (kind is int and isinstance(raw, bool)):
        raise TypeError
    return raw


def _described(kind: Any) -> str:
    if get_origin(kind) is list:
        return f"a list, each {_described(get_args(kind)[0])}, e.g. [a, b]"
    return _NAMES.get(kind, str(kind))


def _nearest(key: str, known: Sequence[str]) -> list[str]:
    """Return up to three known keys that are spelt nearly like `key`, or end like it."""
    last = key.rpartition(".")[2]
    same = [name for name in known if name.rpartition(".")[2] == last]
    near = difflib.get_close_matches(key, known, n=3)
    tails = {name.rpartition(".")[2]: name for name in reversed(known)}
    near += [tails[tail] for tail in difflib.get_close_matches(last, list(tails), n=3, cutoff=0.75)]
    return list(dict.fromkeys([*same, *near]))[:3]
