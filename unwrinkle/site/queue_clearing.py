"""The operator's confirmation before the controller's queues are emptied."""

from rich.console import Console

from unwrinkle.hardware.controller.clear_queue import clear_queue
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import Site

#: What is typed to confirm.
WORD = "clear"


def clear_confirmed(site: Site, console: Console) -> None:
    """Ask, then empty the queues that a dead motion connection may have left in the controller.

    Raises:
        InputError: nobody confirmed it.
        HardwareError: see `clear_queue`.
    """
    console.print(
        "A stop will be sent as the first bytes of a motion connection. The controller may still run one interpolation "
        "period of what is in its queues: keep clear of the robot, and the emergency stop in reach. HOLD on the pendant "
        "does the same without a connection (MotoROS 1.9.12).",
        highlight=False,
        soft_wrap=True,
    )
    try:
        typed = console.input(f"Type '{WORD}' to go on: ")
    except EOFError:
        typed = ""
    if typed.strip().lower() != WORD:
        raise InputError(f"the queues were not touched: '{WORD}' confirms it, not '{typed[:12]}'")
    console.print(clear_queue(site.controller).text, highlight=False, soft_wrap=True)
