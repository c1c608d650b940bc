"""Kinds of grippers that a site may name, and their opening."""

from collections.abc import Callable
from dataclasses import dataclass

from unwrinkle.hardware.backend import check_kind, imported
from unwrinkle.hardware.controller.base import DigitalIo
from unwrinkle.hardware.grippers.base import Grippers
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import NO_DEVICE, GripperSite

#: Opens grippers: the site, the controller's inputs and outputs, and the opening of an open
#: gripper, m.
GripperOpener = Callable[[GripperSite, DigitalIo | None, float | None], Grippers]


@dataclass(frozen=True)
class GripperKind:
    """Driver of one kind of grippers.

    Attributes:
        opener: function, or "module:function", imported on first use.
        needs_io: whether it uses the controller's inputs and outputs.
    """

    opener: str | GripperOpener
    needs_io: bool = False


#: Drivers by the site's `grippers.kind`; a new gripper is a line here.
GRIPPERS = {
    "digital": GripperKind("unwrinkle.hardware.grippers.digital_io:open_digital", needs_io=True),
    "can": GripperKind("unwrinkle.hardware.grippers.can_bus:open_can"),
}


def needs_io(site: GripperSite) -> bool:
    """Return whether a site's grippers use the controller's inputs and outputs."""
    return site.kind != NO_DEVICE and _kind(site).needs_io


def make_grippers(
    site: GripperSite, io: DigitalIo | None = None, stroke: float | None = None
) -> Grippers:
    """Open the grippers that a site names; nothing moves.

    Args:
        site: of the grippers.
        io: the controller's inputs and outputs, for grippers on them.
        stroke: opening of an open gripper, m, for grippers that measure it.

    Raises:
        InputError: the site names none, or they need a controller.
        HardwareError: their bus cannot be opened.
    """
    if site.kind == NO_DEVICE:
        raise InputError(f"grippers.kind is 'none' in the site; give {' or '.join(GRIPPERS)}")
    kind = _kind(site)
    if kind.needs_io and io is None:
        raise InputError(f"{site.kind} grippers need the controller's inputs and outputs")
    opener: GripperOpener = imported(kind.opener) if isinstance(kind.opener, str) else kind.opener
    return opener(site, io, stroke)


def _kind(site: GripperSite) -> GripperKind:
    """Return the kind that a site names, registered or "module:name"."""
    check_kind("grippers.kind", site.kind, GRIPPERS)
    if site.kind in GRIPPERS:
        return GRIPPERS[site.kind]
    found = imported(site.kind)
    return found if isinstance(found, GripperKind) else GripperKind(found)
