"""Write Markdown tables."""

from collections.abc import Iterable, Sequence


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table, a header and a line per row, without a newline at its end.

    Args:
        columns: names in the header.
        rows: of as many cells each.

    Raises:
        ValueError: a row has another number of cells than the header.
    """
    lines = [line(*columns), rule(len(columns))]
    for row in rows:
        if len(row) != len(columns):
            raise ValueError(f"{row}: has {len(row)} cells, the table has {len(columns)} columns")
        lines.append(line(*row))
    return "\n".join(lines)


def cell(text: str) -> str:
    """Return a text as one cell: on one line, its bars escaped."""
    return " ".join(text.split()).replace("|", "\\|")


def line(*cells: str) -> str:
    """Return a line of a table."""
    return "|" + "".join(f" {text} |" if text else " |" for text in cells)


def rule(columns: int) -> str:
    """Return the line below the header of a table with so many columns."""
    return "|" + "---|" * columns
