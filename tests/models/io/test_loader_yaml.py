"""Typed YAML: the schema binds, and errors name file and key."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml


@dataclass
class Open:
    size: float = 1.0
    name: str = ""


@dataclass(frozen=True)
class Frozen:
    size: float = 1.0
    parts: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.size < 0.0:
            raise InputError("size must not be negative")


def _write(folder: Path, text: str) -> Path:
    path = folder / "thing.yaml"
    path.write_text(text)
    return path


def test_reads_both_kinds_and_keeps_defaults(tmp_path: Path) -> None:
    assert load_yaml(_write(tmp_path, "size: 2"), Open) == Open(2.0, "")
    assert load_yaml(_write(tmp_path, "parts: [1, 2]"), Frozen) == Frozen(1.0, [1.0, 2.0])


@pytest.mark.parametrize("schema", [Open, Frozen])
@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("size: 2\ncolour: red", "colour"),
        ("size: wide", "size"),
        ("size: [1", "line 1"),
        ("", "empty"),
        ("- 1", "list"),
    ],
)
def test_refuses_and_names_file_and_key(
    tmp_path: Path, schema: type, text: str, named: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, text), schema)
    assert "thing.yaml" in str(caught.value)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_own_check_of_a_frozen_schema_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"thing\.yaml: size must not be negative"):
        load_yaml(_write(tmp_path, "size: -1"), Frozen)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_yaml(tmp_path / "absent.yaml", Open)


@dataclass
class Nested:
    part: Open = field(default_factory=Open)
    date: str = ""
    size: float = 0.0


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("part: {size: wide}\nsize: 1", "(key part.size)"),
        ("size: []\npart: {name: '[]'}", "(key size)"),
        ("size: 1\npart: {size: x, name: x}", "(key part.size)"),
        ("date: 2024-05-01", "(key date; put it in quotes)"),
    ],
)
def test_the_key_with_the_wrong_value_is_named(tmp_path: Path, text: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, text), Nested)
    assert str(caught.value).endswith(key)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("part: {size: 1, colour: red}", "there is no key 'part.colour'; known: size, name"),
        ("siz: 1", "there is no key 'siz'; did you mean size?"),
        ("part: {nme: a}\nsize: x", "there is no key 'part.nme'; did you mean name?"),
    ],
)
def test_an_unknown_key_is_named_with_the_known_ones(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, text), Nested)
    assert str(caught.value).endswith(words)


def test_the_key_of_a_child_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, "a: {size: wide}\nb: {size: 1}"), Open, child="a")
    assert str(caught.value).endswith("(key size)")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("size: 0.1\nsize: 1.0", "key 'size' is given twice, at lines 1 and 2"),
        ("part:\n  name: a\n  size: 1\n  name: b", "key 'part.name' is given twice"),
        ("part: {size: 1}\ndate: ''\npart: {size: 2}", "key 'part' is given twice"),
        ("part: {size: 1, size: 1}", "key 'part.size' is given twice"),
    ],
)
def test_a_key_given_twice_is_refused(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, text), Nested)
    assert named in str(caught.value)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("part: {name: off}", "part.name"),
        ("part: {name: NO}", "part.name"),
        ("part: {name: 0}", "part.name"),
        ("date: 2024", "date"),
        ("part: {name: 1.5}", "part.name"),
    ],
)
def test_a_text_without_quotes_asks_for_them(tmp_path: Path, text: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        load_yaml(_write(tmp_path, text), Nested)
    assert str(caught.value).endswith(f"(key {key}; put it in quotes)")
    assert "<class" not in str(caught.value)
