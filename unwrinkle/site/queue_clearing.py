"""Ask the operator for confirmation, then empty the controller's queues."""

from rich.console import Console

from unwrinkle.hardware.controller.clear_queue import clear_queue
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import Site

#: Word that the operator types to confirm.
WORD = "clear"


def clear_confirmed(site: Site, console: Console) -> None:
    """Ask for confirmation, then empty the controller's queues of a broken connection.

    Raises:
        InputError: it was not confirmed.
        HardwareError: see `clear_queue`.
    """
    console.print(
        "A stop will be sent as the first bytes of a motion connection. The controller may still "
        "run one interpolation period of the content of its queues: keep clear of the robot, with "
        "the emergency stop in reach. HOLD on the pendant does the same without a connection "
        "(MotoROS 1.9.12).",
        highlight=False,
        soft_wrap=True,
    )
    try:
        typed = console.input(f"Type '{WORD}' to go on: ")
    except EOFError:
        typed = ""
    if typed.strip().lower() != WORD:
        raise InputError(
            f"the queues were not emptied: '{typed[:12]}' was typed, '{WORD}' confirms it; try "
            "again"
        )
    console.print(clear_queue(site.controller).text, highlight=False, soft_wrap=True)
