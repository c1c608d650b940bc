"""Markdown tables."""

import pytest

from benchmarks.harness.tables import cell, table


def test_a_table_has_a_header_and_a_line_per_row() -> None:
    assert table(("a", "b"), [("1", ""), ("2", "3")]) == (
        "| a | b |\n|---|---|\n| 1 | |\n| 2 | 3 |"
    )


def test_a_row_of_another_width_is_refused() -> None:
    with pytest.raises(ValueError):
        table(("a", "b"), [("1",)])


def test_a_cell_is_one_line_without_bars() -> None:
    assert cell("a |\n  b") == "a \\| b"
