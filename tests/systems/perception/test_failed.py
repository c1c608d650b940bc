"""A refused look counts as an empty table by the type of its error, not by its text."""

from typing import Any

import pytest
from pydrake.common.value import AbstractValue

from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError, InsufficientViewError, NoGarmentError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.systems.perception.base import PerceptionSystem


class Refusing(PerceptionSystem):
    """Perception that refuses every look with one error."""

    def __init__(self, error: InputError) -> None:
        super().__init__({"image": DepthImage()}, unseen=0.001)
        self._error = error

    def range_map(self, number: int, *inputs: Any) -> RangeMap:
        raise self._error


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
    system = Refusing(error)
    context = system.CreateDefaultContext()
    system.get_input_port(0).FixValue(context, AbstractValue.Make(DepthImage(3)))
    found = system.GetOutputPort("range_map").Eval(context)
    assert (found.number, found.empty, found.unseen) == (3, empty, 0.001)
    assert found.reason == str(error) and found.range_map is None
