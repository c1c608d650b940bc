"""The faults by their ids, as the field's catalogue counts them."""

from tests.robustness.faults import (
    bytes,
    commands,
    feedback,
    firmware,
    grippers,
    host,
    network,
    planning,
    vision,
)
from tests.robustness.rig.fault import Fault

_MODULES = (network, bytes, feedback, host, commands, planning, vision, grippers, firmware)
#: How many faults of each letter: network, state, host, plan, vision, grippers, operator, firmware.
CATALOGUE = {"N": 9, "S": 5, "C": 4, "P": 7, "V": 6, "G": 2, "H": 2, "F": 8}
#: Faults that take a quarter of a minute or more, since they start `unwrinkle execute` several
#: times.
LONG = frozenset({"C2", "G1", "P4", "V6", "F1"})


def ids() -> list[str]:
    """Return every id of the catalogue, in its order."""
    return [f"{letter}{k}" for letter, count in CATALOGUE.items() for k in range(1, count + 1)]


def faults() -> tuple[Fault, ...]:
    """Return all faults that are injected, in the catalogue's order."""
    known = {fault.id: fault for module in _MODULES for fault in module.FAULTS}
    return tuple(known[name] for name in ids() if name in known)


def fault(name: str) -> Fault:
    """Return the fault of an id.

    Raises:
        KeyError: there is none.
    """
    return {each.id: each for each in faults()}[name]
