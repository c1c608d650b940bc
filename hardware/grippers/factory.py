"""Opening of a site's grippers."""

from unwrinkle.hardware.controller.base import DigitalIo
from unwrinkle.hardware.grippers.base import Grippers
from unwrinkle.hardware.grippers.digital_io import DigitalGrippers
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import GripperSite


def open_grippers(
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
    if site.kind == "can":
        from unwrinkle.hardware.grippers.can_bus import CanGrippers, open_can_bus

        return CanGrippers(site, open_can_bus(site), stroke=stroke)
    if site.kind != "digital":
        raise InputError(f"grippers.kind is '{site.kind}' in the site; give digital or can")
    if io is None:
        raise InputError("digital grippers need the controller's inputs and outputs")
    return DigitalGrippers(site, io)
