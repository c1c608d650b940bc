"""Backends of devices, named as "module:function" and imported on first use."""

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from unwrinkle.models.errors import InputError


def imported(place: str) -> Any:
    """Import what "module:name" names.

    Raises:
        InputError: there is no such module, or it has no such name.
    """
    module, _, name = place.partition(":")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"the driver {place} cannot be imported: {error}") from None


def check_kind(key: str, kind: str, known: Iterable[str]) -> None:
    """Refuse a kind that is neither registered nor a driver of its own.

    Args:
        key: of the site, for the message.
        kind: as the site names it: registered, or "module:name" of a driver elsewhere.
        known: registered kinds.

    Raises:
        InputError: the kind is not registered, or the driver cannot be imported.
    """
    if ":" in kind:
        imported(kind)
        return
    names = list(known)
    if kind not in names:
        raise InputError(f"site: {key} '{kind}' is unknown; known: {', '.join(names)}")
