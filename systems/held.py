"""Values in the abstract states of a diagram, held rather than copied."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydrake.common.value import Value
from pydrake.systems.framework import Context, State

Content = TypeVar("Content")


@dataclass(frozen=True, eq=False)
class Held(Generic[Content]):
    """A value that nobody changes, so that keeping it is as good as copying it.

    Drake copies every abstract state of a diagram whenever one of its systems updates its own,
    hundreds of times a second here, and for Python objects a copy is a deep one.

    Attributes:
        value: frozen, as all values of this project are.
    """

    value: Content

    def __deepcopy__(self, memo: Any) -> "Held[Content]":
        """The same."""
        return self


def held(context: Context, index: Any) -> Any:
    """The value held in an abstract state of a leaf's context."""
    return context.get_abstract_state(int(index)).get_value().value


def hold(state: State, index: Any, value: Any) -> None:
    """Hold another value in an abstract state."""
    state.get_mutable_abstract_state(int(index)).set_value(Held(value))


def model(value: Any) -> Any:
    """Model of an abstract state that holds a value."""
    return Value(Held(value))
