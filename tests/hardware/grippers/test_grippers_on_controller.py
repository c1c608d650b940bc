"""Digital grippers through the controller's driver.

Over TCP to the virtual controller and its virtual grippers.
"""

from collections.abc import Callable
from typing import Any

import pytest

from unwrinkle.hardware.grippers.base import GripperReport
from unwrinkle.hardware.grippers.digital_io import DigitalGrippers
from unwrinkle.models.site import GripperSite
from unwrinkle.simulation.controllers.server import ServerFault
from unwrinkle.simulation.devices.digital_grippers import VirtualDigitalGrippers

SITE = GripperSite(kind="digital", closed_input=[25010, 25011], holding_input=[25012, 25013])


class Grip:
    """Grippers' driver at one end of the rig, the grippers at the other."""

    def __init__(self, rig: Any, cloth: tuple[bool, bool] = (True, True)) -> None:
        self.rig, self.cloth = rig, cloth
        rig.connect()
        self.jaws = VirtualDigitalGrippers(SITE)
        self.driver = DigitalGrippers(SITE, rig.driver)

    def turn(self) -> None:
        controller = self.rig.controller
        controller.inputs.update(self.jaws.update(self.rig.time, controller.outputs, self.cloth))
        self.rig.turn()
        self.driver.poll(self.rig.time)

    def until(self, condition: Callable[[GripperReport], bool], longest: float = 5.0) -> bool:
        end = self.rig.time + longest
        while self.rig.time < end:
            self.turn()
            if condition(self.driver.status):
                return True
        return False


def test_they_close_hold_and_open(make_rig: Callable[..., Any]) -> None:
    grip = Grip(make_rig())
    grip.driver.command(1, (True, False))
    assert grip.until(lambda report: report.command == 1)
    assert grip.jaws.closed == (True, False)
    report = grip.driver.status
    assert (report.closed, report.holding, report.reason) == ((True, False), (True, False), "")
    grip.driver.command(2, (False, False))
    assert grip.until(lambda report: report.command == 2)
    assert grip.jaws.closed == (False, False)


def test_closing_on_nothing_and_slipping_are_seen(make_rig: Callable[..., Any]) -> None:
    grip = Grip(make_rig(), cloth=(True, False))
    grip.driver.command(1, (True, True))
    assert grip.until(lambda report: report.command == 1)
    assert grip.driver.status.holding == (True, False)
    grip.cloth = (False, False)
    assert grip.until(lambda report: report.holding == (False, False), 0.5)


@pytest.mark.parametrize("fault", ["lost_outputs", "no_close"])
def test_a_lost_command_and_a_mute_sensor_end_in_a_reason(
    make_rig: Callable[..., Any], fault: str
) -> None:
    grip = Grip(make_rig(faults=(ServerFault(fault),)))
    begin = grip.rig.time
    grip.driver.command(1, (True, True))
    assert grip.until(lambda report: bool(report.reason))
    assert grip.rig.time - begin == pytest.approx(SITE.timeout, abs=0.1)
    assert "the right gripper is not closed: input 25010 says open" in grip.driver.status.reason
    assert grip.driver.status.command == 0


def test_without_an_io_connection_there_is_a_reason(make_rig: Callable[..., Any]) -> None:
    grip = Grip(make_rig())
    grip.rig.driver.close()
    grip.driver.poll(grip.rig.time)
    grip.driver.command(1, (True, True))
    grip.driver.poll(grip.rig.time + 0.01)
    assert grip.driver.status.reason.startswith("grippers: ")


def test_an_address_that_the_controller_refuses_is_quoted(make_rig: Callable[..., Any]) -> None:
    grip = Grip(make_rig())
    site = GripperSite(kind="digital", close_output=[99, 10011])
    grip.driver = DigitalGrippers(site, grip.rig.driver)
    grip.driver.command(1, (True, True))
    assert grip.until(lambda report: bool(report.reason))
    assert "has not set output 99" in grip.driver.status.reason
    assert "99 cannot be written" in grip.driver.status.reason
