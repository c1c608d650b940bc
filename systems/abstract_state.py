"""Read and set the abstract states of a leaf system.

Drake deep-copies every abstract state of a diagram whenever one of its systems updates its own
state, hundreds of times a second here. The values therefore derive from `Shared`, whose deep copy
is the value itself.
"""

from typing import Any

from pydrake.systems.framework import Context, State

from unwrinkle.models.shared import Shared


def state_value(context: Context, index: Any) -> Any:
    """Return the value of an abstract state of a leaf's context."""
    return context.get_abstract_state(int(index)).get_value()


def set_state_value(state: State, index: Any, value: Shared) -> None:
    """Set the value of an abstract state."""
    state.get_mutable_abstract_state(int(index)).set_value(value)
