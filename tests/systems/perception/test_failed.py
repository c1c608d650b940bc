"""A refused observation counts as an empty table by the type of its error, not by its text."""

import time

import pytest

from unwrinkle.models.errors import InputError, InsufficientViewError, NoGarmentError
from unwrinkle.systems.perception.stereo import failed


@pytest.mark.parametrize(
    ("error", "empty"),
    [
        (NoGarmentError("look 3: nothing stands out"), True),
        (InsufficientViewError("look 3: no garment found"), False),
        (InputError("look 3: no garment found"), False),
    ],
)
def test_only_the_error_type_decides_whether_the_table_is_empty(
    error: InputError, empty: bool
) -> None:
    found = failed(3, error, time.perf_counter(), unseen=0.001)
    assert found.empty is empty
    assert found.reason == str(error) and found.range_map is None
