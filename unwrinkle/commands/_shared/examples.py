"""Examples at the end of a command's help."""

_TITLE = "Examples:"


def examples(*lines: str) -> str:
    """Return the epilog of a command's help: a title and the lines, each in a paragraph."""
    return "\n\n".join([_TITLE, *lines])
