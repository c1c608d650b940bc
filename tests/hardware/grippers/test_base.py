"""The grippers' drivers: bounded strokes on digital outputs and on a CAN bus, on a fake clock."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from typing import Any

import can
import pytest

from unwrinkle.hardware.grippers.base import GripperReport, Grippers
from unwrinkle.hardware.grippers.can_bus import CanGrippers, open_can_bus
from unwrinkle.hardware.grippers.digital_io import DigitalGrippers
from unwrinkle.hardware.grippers.factory import make_grippers
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import GripperSite
from unwrinkle.simulation.devices.can_gripper import VirtualCanGrippers

TICK = 0.01
SITE = GripperSite(kind="digital", closed_input=[25010, 25011], holding_input=[25012, 25013])
CAN_SITE = GripperSite(kind="can", interface="virtual")
_CHANNELS = count()


class Outputs:
    """The controller's inputs and outputs, with grippers behind them that take half a second."""

    def __init__(self, site: GripperSite = SITE) -> None:
        self.site = site
        self.outputs: dict[int, int] = {}
        self.inputs: dict[int, int | None] = {}
        self.outputs_written: dict[int, int | None] = {}
        self.io_problem = ""
        self.writes: list[tuple[int, int]] = []
        self.reads: list[int] = []
        self._waiting: list[tuple[int, int]] = []
        self._changed = [0.0, 0.0]
        self._closed = [False, False]
        self._answering = True
        self.obeys, self.gone = True, False
        self.cloth = [True, True]
        self.stuck = [False, False]

    def write_output(self, address: int, value: int) -> None:
        if self.gone:
            raise HardwareError("there is no I/O connection")
        self.writes.append((address, value))
        self.outputs_written[address] = None
        self._waiting.append((address, value))

    def read_input(self, address: int) -> None:
        if self.gone:
            raise HardwareError("there is no I/O connection")
        self.inputs.setdefault(address, None)
        self.reads.append(address)

    def poll(self, now: float) -> None:
        if not self._answering:
            return
        for address, value in self._waiting:
            self.outputs_written[address] = value
            if self.obeys:
                self.outputs[address] = value
        self._waiting.clear()
        for index, (output, inverted) in enumerate(
            zip(self.site.close_output, self.site.inverted, strict=True)
        ):
            wanted = bool(self.outputs.get(output, inverted)) != inverted
            if wanted != self._closed[index] and not self.stuck[index]:
                if not self._changed[index]:
                    self._changed[index] = now
                elif now - self._changed[index] >= 0.5:
                    self._closed[index], self._changed[index] = wanted, 0.0
        for address in self.reads:
            for index in range(2):
                if address == self.site.closed_input[index]:
                    self.inputs[address] = int(self._closed[index])
                if address == self.site.holding_input[index]:
                    self.inputs[address] = int(self._closed[index] and self.cloth[index])
        self.reads.clear()

    def be_silent(self) -> None:
        self._answering = False


class Bench:
    """A driver and what is behind it, polled in turn."""

    def __init__(self, grippers: Grippers, peer: Any) -> None:
        self.grippers, self.peer, self.now = grippers, peer, 0.0

    @property
    def status(self) -> GripperReport:
        return self.grippers.status

    def run(self, time: float, until: Callable[[GripperReport], bool] | None = None) -> bool:
        for _ in range(round(time / TICK)):
            self.grippers.poll(self.now)
            self.peer.poll(self.now)
            self.now += TICK
            if until is not None and until(self.status):
                return True
        return False

    def done(self, number: int, closed: tuple[bool, bool]) -> bool:
        self.grippers.command(number, closed)
        return self.run(6.0, lambda report: report.command == number)

    def failed(self, number: int, closed: tuple[bool, bool]) -> bool:
        self.grippers.command(number, closed)
        return self.run(6.0, lambda report: bool(report.reason))


def digital(site: GripperSite = SITE) -> Bench:
    outputs = Outputs(site)
    return Bench(DigitalGrippers(site, outputs), outputs)


@pytest.fixture
def on_can() -> Iterator[Bench]:
    channel = f"grippers {next(_CHANNELS)}"
    site = replace(CAN_SITE, channel=channel)
    with can.Bus(interface="virtual", channel=channel) as far:
        peer = VirtualCanGrippers(far)
        grippers = CanGrippers(site, open_can_bus(site), stroke=0.06)
        yield Bench(grippers, peer)
        grippers.close()


# On digital outputs.


def test_nothing_is_written_before_a_command() -> None:
    bench = digital()
    assert not bench.run(1.0, lambda report: report.command > 0)
    assert bench.peer.writes == []
    assert bench.status.closed == (False, False)
    assert bench.status.holding == (False, False)


@pytest.mark.parametrize("inverted", [True, False])
def test_closing_and_opening_write_the_sites_outputs(inverted: bool) -> None:
    bench = digital(replace(SITE, inverted=[inverted, inverted]))
    assert bench.done(1, (True, False))
    assert bench.peer.writes == [(10010, int(not inverted)), (10011, int(inverted))]
    assert bench.status.closed == (True, False)
    assert bench.status.holding == (True, False)
    assert bench.done(2, (False, False))
    assert bench.status.closed == (False, False)


def test_a_stroke_takes_at_least_its_time_and_what_the_sensors_need() -> None:
    bench = digital()
    assert bench.done(1, (True, True))
    assert 0.75 <= bench.now <= 1.0


def test_without_sensors_the_stroke_is_timed_and_holding_is_not_known() -> None:
    bench = digital(GripperSite(kind="digital"))
    assert bench.done(1, (True, True))
    assert 0.75 <= bench.now <= 0.85
    assert bench.status.closed == (True, True)
    assert bench.status.holding == (None, None)


def test_a_gripper_that_closes_on_nothing_says_so() -> None:
    bench = digital()
    bench.peer.cloth = [True, False]
    assert bench.done(1, (True, True))
    assert bench.status.holding == (True, False)
    assert bench.status.reason == ""


def test_cloth_that_slips_later_is_seen() -> None:
    bench = digital()
    assert bench.done(1, (True, True))
    bench.peer.cloth = [False, True]
    assert bench.run(0.2, lambda report: report.holding == (False, True))


def test_a_gripper_that_does_not_close_is_named_after_the_timeout() -> None:
    bench = digital()
    bench.peer.stuck = [True, False]
    assert bench.failed(1, (True, True))
    assert 3.0 <= bench.now <= 3.1
    assert "the right gripper is not closed: input 25010 says open" in bench.status.reason
    assert "left" not in bench.status.reason
    assert bench.status.command == 0


def test_a_lost_command_is_sent_once_more_and_no_more() -> None:
    bench = digital()
    bench.peer.obeys = False
    bench.grippers.command(1, (True, True))
    bench.run(1.0)
    bench.peer.obeys = True
    assert bench.run(6.0, lambda report: report.command == 1)
    bench.peer.obeys = False
    bench.peer.writes.clear()
    assert bench.failed(2, (False, False))
    bench.run(10.0)
    assert len(bench.peer.writes) == 4
    assert "is not open: input 25010 says closed" in bench.status.reason


def test_after_a_failure_it_opens_when_told_to() -> None:
    bench = digital()
    bench.peer.stuck = [True, False]
    assert bench.failed(1, (True, True))
    bench.peer.stuck = [False, False]
    assert bench.done(2, (False, False))
    assert bench.status.reason == ""


def test_a_controller_that_does_not_answer_is_a_reason() -> None:
    bench = digital()
    bench.peer.be_silent()
    bench.peer.io_problem = "10010 cannot be written: address out of range"
    assert bench.failed(1, (True, False))
    assert "has not set output 10010" in bench.status.reason
    assert "address out of range" in bench.status.reason


def test_without_a_connection_it_is_a_reason_at_once() -> None:
    bench = digital(GripperSite(kind="digital"))
    bench.peer.gone = True
    assert bench.failed(1, (True, True))
    assert bench.now < 0.1
    assert "no I/O connection" in bench.status.reason


def test_an_old_number_is_no_new_command() -> None:
    bench = digital()
    assert bench.done(5, (True, True))
    bench.grippers.command(5, (False, False))
    bench.grippers.command(4, (False, False))
    bench.run(1.0)
    assert bench.status.closed == (True, True)


def test_a_clock_that_steps_back_ends_no_stroke_early() -> None:
    bench = digital(GripperSite(kind="digital"))
    bench.now = 1e5
    bench.grippers.command(1, (True, True))
    bench.run(0.3)
    bench.now = 0.0
    assert not bench.run(0.4, lambda report: report.command == 1)
    assert bench.run(0.2, lambda report: report.command == 1)


# On a CAN bus.


def test_can_closing_and_opening(on_can: Bench) -> None:
    assert on_can.done(1, (True, False))
    assert on_can.status.closed == (True, False)
    assert on_can.status.holding == (True, False)
    assert on_can.status.opening == pytest.approx((0.0012, 0.06))
    # The right gripper is limb 1.
    assert on_can.peer.commands == [(1, b"\x13"), (0, b"\x0f")]
    assert on_can.done(2, (False, True))
    assert on_can.status.closed == (False, True)


def test_can_blades_that_close_wholly_hold_nothing(on_can: Bench) -> None:
    on_can.peer.cloth = (True, False)
    assert on_can.done(1, (True, True))
    assert on_can.status.holding == (True, False)
    on_can.peer.faults.add("lost_cloth")
    assert on_can.run(1.0, lambda report: report.holding == (False, False))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("silent", "the right gripper (limb 1) does not answer on CAN bus"),
        ("no_close", "not closed: it stands at 0 % of its closure"),
        ("uncalibrated", "not calibrated"),
    ],
)
def test_can_faults_are_named_after_the_timeout(on_can: Bench, fault: str, words: str) -> None:
    on_can.peer.faults.add(fault)
    assert on_can.failed(1, (True, True))
    assert words in on_can.status.reason
    assert 3.0 <= on_can.now <= 3.1


def test_can_a_gripper_that_falls_silent_is_not_known_to_hold(on_can: Bench) -> None:
    assert on_can.done(1, (True, True))
    on_can.peer.faults.add("silent")
    on_can.run(1.0)
    assert on_can.status.holding == (None, None)
    assert on_can.status.opening is None


def test_can_frames_of_others_are_not_taken(on_can: Bench) -> None:
    on_can.run(0.3)
    before = on_can.status
    with can.Bus(interface="virtual", channel=on_can.grippers._site.channel) as other:  # type: ignore[attr-defined]
        for identifier, data in (
            (0x201, b"\x0d\x27\x10"),
            (0x203, b"\x0d\x27\x10\x00\x00\x02"),
            (0x401, b"\x0d\x27\x10\x00\x00\x02"),
            (0x201, b"\x0d\xff\xff\x00\x00\x02"),
            (0x201, b""),
        ):
            other.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        on_can.run(0.02)
    assert on_can.status == before


def test_can_a_bus_that_fails_is_a_reason() -> None:
    class Broken:
        def send(self, msg: Any, timeout: float | None = None) -> None:
            raise can.CanOperationError("bus off")

        def recv(self, timeout: float | None = None) -> Any:
            return None

        def shutdown(self) -> None:
            pass

    grippers = CanGrippers(CAN_SITE, Broken())
    grippers.poll(0.0)
    assert "bus off" in grippers.status.reason


# Opening what a site has.


def test_grippers_are_opened_as_the_site_says() -> None:
    assert isinstance(make_grippers(SITE, Outputs()), DigitalGrippers)
    site = replace(CAN_SITE, channel=f"grippers {next(_CHANNELS)}")
    grippers = make_grippers(site)
    assert isinstance(grippers, CanGrippers)
    grippers.close()
    with pytest.raises(InputError, match="'none'"):
        make_grippers(GripperSite())
    with pytest.raises(InputError, match="need the controller"):
        make_grippers(SITE)
    with pytest.raises(HardwareError, match="cannot open CAN interface no-such"):
        make_grippers(replace(CAN_SITE, interface="no-such"))
