"""Choices that scenario files, the command line and perception share, one enum each.

A member is its value as text, so that YAML and JSON files hold the plain word.
"""

from __future__ import annotations

from enum import StrEnum

from unwrinkle.models.errors import InputError


class NamedChoice(StrEnum):
    """Base of the enums; `Enum(text)` raises InputError for unknown text and lists the known."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        raise InputError(f"{cls._label()} {value!r}: must be one of {', '.join(cls)}")

    @classmethod
    def _label(cls) -> str:
        """Return what a message calls this choice."""
        return cls.__name__


class PullReading(NamedChoice):
    """Reading of Eq. 5, the pull distance of a wrinkle (the `mode` of a target).

    FOOT measures the slack between the wrinkle's feet, CONTOUR between its inflection contours (as
    the source paper states it), MEAN is the mean of both.
    """

    FOOT = "foot"
    CONTOUR = "paper"
    MEAN = "between"

    @classmethod
    def _label(cls) -> str:
        return "mode"


class SectionPlace(NamedChoice):
    """Where along a wrinkle the section lies that both hands pull: its centre or highest part."""

    CENTRE = "centre"
    HIGHEST = "highest"

    @classmethod
    def _label(cls) -> str:
        return "section"


class PulledSlack(NamedChoice):
    """Slack that a pull removes: of the wrinkle (Eq. 5), or of everything on the section."""

    WRINKLE = "wrinkle"
    SECTION = "section"

    @classmethod
    def _label(cls) -> str:
        return "pull"
