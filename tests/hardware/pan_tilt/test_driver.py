"""The pan-tilt unit's driver, against a virtual unit on a fake clock.

What it sends, refuses and survives.
"""

from collections.abc import Callable
from math import nan, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.hardware.pan_tilt.base import PanTiltStatus
from unwrinkle.hardware.pan_tilt.driver import ARC_SECOND, PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import open_serial
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import PanTiltSite
from unwrinkle.simulation.devices.serial_pan_tilt import UnitSettings, VirtualSerialPanTilt

STEP = 185.1428 * ARC_SECOND
TICK = 0.008


class Line:
    """A unit in memory, on the test's clock."""

    def __init__(self, unit: VirtualSerialPanTilt, split: int = 0) -> None:
        self.unit, self.now, self.split = unit, 0.0, split
        self.to_unit, self.to_driver = b"", b""
        self.written: list[bytes] = []
        self.gone = ""
        self.disturb: Callable[[bytes], bytes] = lambda data: data

    def read(self) -> bytes:
        if self.gone:
            raise HardwareError(f"/dev/ttyUSB7 is gone: {self.gone}")
        most = self.split or len(self.to_driver)
        data, self.to_driver = self.to_driver[:most], self.to_driver[most:]
        return data

    def write(self, data: bytes) -> None:
        self.written.append(data)
        self.to_unit += data

    def close(self) -> None:
        self.gone = "closed"

    def poll(self, now: float) -> None:
        data, self.to_unit = self.to_unit, b""
        self.to_driver += self.disturb(self.unit.receive(data, now))


class Bench:
    """A driver and its unit."""

    def __init__(
        self,
        *faults: str,
        expected: float | None = STEP,
        split: int = 0,
        unit: VirtualSerialPanTilt | None = None,
    ) -> None:
        self.unit = unit or VirtualSerialPanTilt(faults=faults)
        self.line = Line(self.unit, split)
        self.driver = PanTiltDriver(self.line, PanTiltSite(), expected, "left unit")
        self.now = 0.0

    def run(self, time: float, until: Callable[[PanTiltStatus], bool] | None = None) -> bool:
        """Poll both in turn; whether the condition came true."""
        for _ in range(round(time / TICK)):
            self.driver.poll(self.now)
            self.line.poll(self.now)
            self.now += TICK
            if until is not None and until(self.driver.status):
                return True
        return False

    def still(self, time: float = 20.0) -> bool:
        return self.run(time, lambda status: status.still)

    def fault(self, time: float = 20.0) -> bool:
        return self.run(time, lambda status: status.state == "fault")


def test_it_learns_resolution_and_limits_and_moves_nothing() -> None:
    bench = Bench()
    assert bench.still()
    assert bench.driver.steps == pytest.approx((STEP, STEP))
    pan, tilt = bench.driver.limits
    assert (*pan, *tilt) == pytest.approx(
        tuple(STEP * end for end in (-3090, 3090, -907, 604)), abs=1e-9
    )
    assert bench.unit.commands[:4] == ["FT", "ED", "CI", "I"]
    moving = [c for c in bench.unit.commands if len(c) > 2 or c in ("R", "A", "H")]
    assert moving == []


@settings(max_examples=25, deadline=None)
@given(pan=st.floats(-2.7, 2.7), tilt=st.floats(-0.8, 0.5))
def test_it_goes_to_the_nearest_whole_step_and_says_so(pan: float, tilt: float) -> None:
    bench = Bench()
    assert bench.still()
    bench.driver.goto(1, pan, tilt)
    assert not bench.driver.status.still
    assert bench.still()
    status = bench.driver.status
    assert bench.unit.goal == (round(pan / STEP), round(tilt / STEP))
    assert (status.pan, status.tilt) == pytest.approx((pan, tilt), abs=0.51 * STEP)
    assert (status.number, status.reason) == (1, "")


def test_it_is_still_only_after_the_mount_has_settled() -> None:
    bench = Bench()
    assert bench.still()
    bench.driver.goto(1, 0.4, 0.0)
    assert bench.run(20.0, lambda status: status.state == "settling")
    arrived = bench.now
    assert bench.still()
    assert bench.now - arrived >= PanTiltSite().settle - TICK


def test_a_command_before_it_knows_its_limits_waits() -> None:
    bench = Bench()
    bench.driver.goto(1, 0.2, 0.1)
    assert bench.driver.status.number == 1
    assert bench.still()
    assert bench.unit.goal == (round(0.2 / STEP), round(0.1 / STEP))


def test_a_new_command_replaces_the_old_one_on_the_way() -> None:
    bench = Bench()
    assert bench.still()
    bench.driver.goto(1, 2.0, 0.0)
    bench.run(0.3)
    bench.driver.goto(2, -0.1, 0.1)
    assert bench.still()
    assert bench.driver.status.pan == pytest.approx(-0.1, abs=STEP)
    assert bench.driver.status.number == 2


def test_an_old_number_is_no_new_command() -> None:
    bench = Bench()
    assert bench.still()
    bench.driver.goto(3, 0.1, 0.0)
    bench.driver.goto(3, 0.5, 0.0)
    bench.driver.goto(2, 0.5, 0.0)
    assert bench.still()
    assert bench.driver.status.pan == pytest.approx(0.1, abs=STEP)


@pytest.mark.parametrize(
    ("pan", "tilt", "words"),
    [(2.9, 0.0, "pan 2.9000 rad"), (0.0, -0.9, "tilt -0.9000 rad"), (nan, 0.0, "finite")],
)
def test_beyond_its_limits_it_refuses_and_sends_nothing(
    pan: float, tilt: float, words: str
) -> None:
    bench = Bench()
    assert bench.still()
    before = list(bench.unit.commands)
    bench.driver.goto(1, pan, tilt)
    assert bench.run(0.5) is False
    status = bench.driver.status
    assert status.number == 1
    assert words in status.reason
    assert "left unit" in status.reason
    assert {c for c in bench.unit.commands[len(before) :]} <= {"PP", "TP"}
    bench.driver.goto(2, 0.1, 0.1)
    assert bench.still()
    assert bench.driver.status.reason == ""


def test_a_unit_that_refuses_a_position_is_quoted_in_plain_words() -> None:
    bench = Bench()
    assert bench.still()
    # Its limits have been changed behind the driver's back.
    narrow = VirtualSerialPanTilt(UnitSettings(pan=(-100, 100), echo=False, verbose=False))
    bench.line.unit = narrow
    bench.driver.goto(1, 1.0, 0.0)
    assert bench.still()
    assert "above its largest position" in bench.driver.status.reason
    assert narrow.goal == (0, 0)


@pytest.mark.parametrize("split", [1, 2, 3])
def test_any_split_of_its_answers_is_the_same(split: int) -> None:
    bench = Bench(split=split)
    bench.driver.goto(1, 0.3, -0.2)
    assert bench.still(60.0)
    assert bench.driver.status.pan == pytest.approx(0.3, abs=STEP)


def test_noise_between_the_answers_is_survived() -> None:
    bench = Bench("noise")
    bench.driver.goto(1, 0.3, -0.2)
    assert bench.still(60.0)
    assert bench.unit.goal == (round(0.3 / STEP), round(-0.2 / STEP))
    assert bench.driver.status.pan == pytest.approx(0.3, abs=STEP)


def test_a_lost_answer_is_asked_for_again() -> None:
    bench = Bench()
    assert bench.still()
    lost = [3]

    def disturb(data: bytes) -> bytes:
        if data and lost[0]:
            lost[0] -= 1
            return b"" if lost[0] == 1 else data
        return data

    bench.line.disturb = disturb
    bench.driver.goto(1, 0.3, 0.0)
    assert bench.still()
    assert bench.unit.goal[0] == round(0.3 / STEP)


def test_a_late_answer_does_not_pass_for_the_next_one() -> None:
    bench = Bench()
    assert bench.still()
    held: list[tuple[float, bytes]] = []

    def delay(data: bytes) -> bytes:
        if data:
            held.append((bench.now + 1.02, data))
        due = b"".join(d for when, d in held if when <= bench.now)
        held[:] = [(when, d) for when, d in held if when > bench.now]
        return due

    bench.line.disturb = delay
    bench.driver.goto(1, 0.3, -0.2)
    assert bench.fault()
    # Every answer came after its deadline: none was taken for that of another question.
    assert bench.driver.status.pan in (0.0, pytest.approx(0.3, abs=STEP))
    assert "no answer" in bench.driver.status.reason


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("silent", "no answer to FT"),
        ("garbage", "to FT in 3 attempts"),
        ("error", "Illegal command"),
    ],
)
def test_a_unit_that_cannot_be_talked_to_is_a_named_fault(fault: str, words: str) -> None:
    bench = Bench(fault)
    assert bench.fault()
    reason = bench.driver.status.reason
    assert words in reason
    assert reason.startswith("left unit: ")
    assert not bench.driver.status.still


def test_a_fault_latches_until_a_restart() -> None:
    bench = Bench()
    assert bench.still()
    bench.unit.faults.add("silent")
    assert bench.fault()
    bench.unit.faults.clear()
    written = len(bench.line.written)
    bench.driver.goto(1, 0.1, 0.0)
    bench.driver.goto(2, 0.1, 0.0)
    bench.run(5.0)
    assert len(bench.line.written) == written
    assert bench.driver.status.reason.count("restarted") == 1
    bench.driver.restart()
    assert bench.still()
    bench.driver.goto(3, 0.1, 0.0)
    assert bench.still()
    assert bench.driver.status.pan == pytest.approx(0.1, abs=STEP)


def test_motors_that_do_not_turn_are_a_fault_that_says_where_it_stands() -> None:
    bench = Bench()
    assert bench.still()
    bench.unit.faults.add("stuck")
    bench.driver.goto(1, 0.3, 0.0)
    assert bench.fault()
    assert "within 6 s; it stands at 0, 0" in bench.driver.status.reason


def test_a_stop_that_was_hit_is_a_fault_that_names_the_axis() -> None:
    bench = Bench()
    assert bench.still()
    bench.unit.faults.add("limit")
    assert bench.fault()
    assert "pan axis has hit its stop" in bench.driver.status.reason


def test_a_unit_in_another_step_mode_is_refused() -> None:
    unit = VirtualSerialPanTilt(UnitSettings(resolution=(185.1428, 46.2857)))
    bench = Bench(unit=unit)
    assert bench.fault()
    assert "tilt resolution is 46.2857" in bench.driver.status.reason
    free = Bench(unit=VirtualSerialPanTilt(unit._settings), expected=None)
    assert free.still()
    assert free.driver.steps[1] == pytest.approx(46.2857 / 3600.0 * pi / 180.0)


def test_a_unit_turned_by_hand_is_not_still_before_it_rests() -> None:
    bench = Bench()
    assert bench.still()
    bench.unit._mechanics.command(200, 0)
    assert bench.run(2.0, lambda status: not status.still)
    assert bench.still()
    assert bench.driver.status.pan == pytest.approx(200 * STEP)


def test_a_cable_pulled_out_is_a_fault_with_its_device() -> None:
    bench = Bench()
    assert bench.still()
    bench.line.gone = "no such device"
    assert bench.fault(0.1)
    assert "/dev/ttyUSB7 is gone" in bench.driver.status.reason


def test_a_line_that_is_never_quiet_is_given_up() -> None:
    bench = Bench()
    bench.line.disturb = lambda data: b"\x00\xff" * 20
    assert bench.fault()
    assert "never quiet" in bench.driver.status.reason


def test_a_device_that_is_not_there_is_named() -> None:
    with pytest.raises(HardwareError, match="/dev/no-such-port at 9600"):
        open_serial("/dev/no-such-port", 9600)


@settings(max_examples=50, deadline=None)
@given(
    chunks=st.lists(
        st.one_of(
            st.binary(max_size=12), st.sampled_from([b"*\r", b"!", b"!P\r", b"* 7\r", b"\r"])
        ),
        max_size=40,
    ),
    lost=st.sets(st.integers(0, 40)),
)
def test_whatever_comes_it_ends_still_or_in_a_fault(chunks: list[bytes], lost: set[int]) -> None:
    bench = Bench()
    disturbances = iter(enumerate(chunks))

    def disturb(data: bytes) -> bytes:
        if not data:
            return data
        index, chunk = next(disturbances, (-1, b""))
        return chunk if index in lost else chunk + data

    bench.line.disturb = disturb
    bench.driver.goto(1, 0.1, -0.05)
    assert bench.run(60.0, lambda s: s.still or s.state == "fault")
    wanted = (round(0.1 / STEP), round(-0.05 / STEP))
    assert bench.unit.goal in {(0, 0), (wanted[0], 0), (0, wanted[1]), wanted}
    assert {c for c in bench.unit.commands if len(c) > 2} <= {f"PP{wanted[0]}", f"TP{wanted[1]}"}
