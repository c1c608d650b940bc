"""The safety page: what it points at exists, and the numbers in it are the settings' own."""

import re
from pathlib import Path

import pytest

from tests.robustness import catalogue
from unwrinkle.models.site import ControllerSite

pytestmark = pytest.mark.alone


@pytest.fixture(scope="module")
def page(repository: Path) -> str:
    return (repository / "docs" / "concepts" / "safety.md").read_text(encoding="utf-8")


def test_it_begins_with_what_the_software_is_not(page: str) -> None:
    first = page.split("\n## ")[1]
    assert first.startswith("What this software is not")
    assert "not a safety function" in first and "your risk assessment" in " ".join(first.split())


def test_the_promises_each_name_what_holds_them(page: str) -> None:
    part = page.split("## Thirteen promises")[1].split("\nBesides")[0]
    promises = re.split(r"\n(?=\d+\. )", part)[1:]
    assert [int(text.split(".")[0]) for text in promises] == list(range(1, 14))
    for text in promises:
        assert re.search(r"\b[NSCPVGHF]\d\b", text) or "tests/" in text, text


def test_rows_and_tests_that_it_names_exist(page: str, repository: Path) -> None:
    known = set(catalogue.ids())
    named = set(re.findall(r"\b([NSCPVGHF]\d)\b", page))
    assert named and named <= known
    for file, _, name in (
        match.partition("::") for match in re.findall(r"`(tests/[\w/.]+(?:::\w+)?)`", page)
    ):
        path = repository / file
        assert path.is_file(), file
        assert f"def {name or 'test_'}" in path.read_text(encoding="utf-8"), (file, name)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("lead", "0.12 s"),
        ("start_tolerance", "0.3 mrad"),
        ("hold_after", "0.10 s"),
        ("fault_after", "0.25 s"),
        ("following", "20 mrad"),
        ("latency", "0.25 s"),
        ("late", "50 ms"),
        ("late_budget", "20"),
    ],
)
def test_numbers_are_the_settings_own(page: str, setting: str, text: str) -> None:
    number, _, unit = text.partition(" ")
    scale = {"s": 1.0, "mrad": 1e-3, "ms": 1e-3, "": 1.0}[unit]
    assert float(number) * scale == pytest.approx(getattr(ControllerSite(), setting))
    assert re.search(rf"`{setting}`[\s,(]+{re.escape(text)}", page), setting
