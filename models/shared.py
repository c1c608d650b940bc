"""Values that are shared instead of copied."""

from typing import Any, Self


class Shared:
    """Base of frozen values: a copy or a deep copy is the value itself.

    Drake deep-copies the abstract values of a diagram's state at every update, and those of ports
    where they are read.
    """

    def __copy__(self) -> Self:
        """Return the value itself."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return the value itself."""
        return self
