"""Virtual grippers on digital outputs: strokes, inversion, sensors that are not there."""

from unwrinkle.models.site import GripperSite
from unwrinkle.simulation.devices.digital_grippers import VirtualDigitalGrippers

SITE = GripperSite(
    kind="digital", closed_input=[25010, 25011], holding_input=[25012, 0], inverted=[True, False]
)


def test_a_gripper_closes_after_its_stroke() -> None:
    grippers = VirtualDigitalGrippers(SITE)
    outputs: dict[int, int] = {}
    open_ = {25010: 0, 25012: 0, 25011: 0}
    assert grippers.update(0.0, outputs) == open_  # never written: open, inverted or not
    outputs |= {10010: 0, 10011: 0}  # the right one is inverted: 0 closes it
    assert grippers.update(1.0, outputs) == open_
    assert grippers.commanded == (True, False)
    assert grippers.update(1.49, outputs) == open_
    assert grippers.update(1.5, outputs) == {25010: 1, 25012: 1, 25011: 0}
    assert grippers.closed == (True, False)
    outputs |= {10010: 1, 10011: 1}
    grippers.update(2.0, outputs)
    assert grippers.update(2.5, outputs) == {25010: 0, 25012: 0, 25011: 1}


def test_a_gripper_that_closes_on_nothing_holds_nothing() -> None:
    grippers = VirtualDigitalGrippers(SITE, stroke_time=0.0)
    assert grippers.update(0.0, {10010: 0}, (False, True)) == {25010: 1, 25012: 0, 25011: 0}
