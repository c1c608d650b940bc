"""Choices as enums: plain words in files, and an error that lists them for another word."""

import json

import pytest

from unwrinkle.models.choices import PulledSlack, PullReading, SectionPlace
from unwrinkle.models.errors import InputError


def test_a_choice_is_its_word_in_files() -> None:
    assert json.loads(json.dumps({"mode": PullReading.CONTOUR})) == {"mode": "paper"}
    assert PullReading("between") is PullReading.MEAN
    assert f"{SectionPlace.HIGHEST}" == "highest"


@pytest.mark.parametrize(
    ("choice", "known"),
    [(PullReading, "foot, paper, between"), (SectionPlace, "centre"), (PulledSlack, "section")],
)
def test_an_unknown_word_is_an_input_error_that_lists_the_known(choice: type, known: str) -> None:
    with pytest.raises(InputError, match=known):
        choice("feet")
