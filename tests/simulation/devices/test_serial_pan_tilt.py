"""The virtual pan-tilt unit behind its serial line, and the pseudo-terminal it can stand on."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.hardware.pan_tilt.driver import PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import SerialLink, fill, open_serial
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import PanTiltSite
from unwrinkle.simulation.devices.serial_pan_tilt import (
    PtyPort,
    SteppedMechanics,
    UnitSettings,
    VirtualSerialPanTilt,
)

TERSE = UnitSettings(echo=False, verbose=False)


def unit(**settings: object) -> VirtualSerialPanTilt:
    return VirtualSerialPanTilt(TERSE, **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"PP\r", b"* 0\r\n"),
        (b"pr ", b"* 185.1428\r\n"),
        (b"TN\r", b"* -907\r\n"),
        (b"TX\r", b"* 604\r\n"),
        (b"PP100\r", b"*\r\n"),
        (b"PP4000\r", b"! Maximum allowable Pan position is 3090\r\n"),
        (b"TP-1000\r", b"! Minimum allowable Tilt position is -907\r\n"),
        (b"PPx\r", b"! Illegal argument\r\n"),
        (b"XX\r", b"! Illegal command\r\n"),
        (b"PS99999\r", b"! Value out of range\r\n"),
        (b"FT ED\r", b"*\r\n*\r\n"),
    ],
)
def test_it_answers_as_the_manual_says(command: bytes, answer: bytes) -> None:
    assert unit().receive(command, 0.0) == answer


def test_after_power_on_it_echoes_and_speaks_in_sentences() -> None:
    fresh = VirtualSerialPanTilt()
    assert fresh.receive(b"PP\r", 0.0) == b"PP\r* Current Pan position is 0\r\n"
    fresh.receive(b"FT ED\r", 0.0)
    assert fresh.receive(b"PP\r", 0.0) == b"* 0\r\n"


@given(cuts=st.lists(st.integers(0, 20), max_size=6))
def test_any_split_of_its_commands_is_the_same(cuts: list[int]) -> None:
    words = b"PP100 TP-50\rPO PS800 PP"
    split = unit()
    ends = sorted({0, len(words), *(min(cut, len(words)) for cut in cuts)})
    out = b"".join(split.receive(words[a:b], 0.0) for a, b in pairwise(ends))
    assert out + split.receive(b"\r", 0.0) == b"*\r\n*\r\n* 100\r\n*\r\n* 0\r\n"
    assert split.goal == (100, -50)


def test_its_axes_keep_their_speed_and_acceleration() -> None:
    axes = SteppedMechanics(1000.0, 2000.0)
    axes.position(0.0)
    axes.command(1000, -100)
    times = [0.001 * k for k in range(1700)]
    pan = [axes.position(t)[0] for t in times]
    assert max(b - a for a, b in pairwise(pan)) <= 2
    assert pan == sorted(pan)
    assert axes.position(0.25)[0] == pytest.approx(62, abs=1)
    # A way of 1000 at 1000/s with ramps of 0.5 s takes 1.5 s.
    assert axes.position(1.4)[0] < 1000
    assert axes.position(1.5) == (1000, -100)


def test_it_answers_await_only_when_it_has_arrived() -> None:
    moved = unit()
    assert moved.receive(b"PP500 A PP\r", 0.0) == b"*\r\n"
    assert moved.receive(b"", 0.4) == b""
    assert moved.receive(b"", 2.0) == b"*\r\n* 500\r\n"


def test_slaved_it_moves_both_axes_at_await() -> None:
    moved = unit()
    moved.receive(b"S PP500 TP100\r", 0.0)
    assert moved.goal == (0, 0)
    moved.receive(b"A\r", 0.1)
    assert moved.goal == (500, 100)


def test_halt_stops_where_it_is() -> None:
    moved = unit()
    moved.receive(b"PP2000\r", 0.0)
    assert moved.receive(b"H\r", 1.0) == b"*\r\n"
    assert 0 < moved.goal[0] < 1000
    assert moved.receive(b"PP\r", 5.0) == f"* {moved.goal[0]}\r\n".encode()


def test_reset_ends_at_zero_with_four_stops() -> None:
    moved = unit()
    moved.receive(b"PP500\r", 0.0)
    moved.receive(b"R\r", 3.0)
    assert moved.receive(b"PP\r", 9.0) == b"!T!T!P!P*\r\n* 0\r\n"


def test_other_mechanics_can_stand_behind_it() -> None:
    class Recorded:
        commands: list[tuple[int, int]] = []  # noqa: RUF012

        def command(self, pan_steps: int, tilt_steps: int) -> None:
            self.commands.append((pan_steps, tilt_steps))

        def position(self, now: float) -> tuple[int, int]:
            return round(10 * now), 30 - round(20 * now)

    mechanics = Recorded()
    moved = unit(mechanics=mechanics)
    assert moved.receive(b"PP100 TP50 PP TP\r", 2.0) == b"*\r\n*\r\n* 20\r\n* -10\r\n"
    assert mechanics.commands == [(100, 30), (100, 50)]


def test_endless_words_are_dropped() -> None:
    flooded = unit()
    out = b"".join(flooded.receive(b"x" * 1000, 0.0) for _ in range(50))
    assert len(flooded._input) <= 4096
    assert b"Illegal" in out


@given(data=st.binary(max_size=200))
def test_random_bytes_move_nothing_beyond_the_limits(data: bytes) -> None:
    disturbed = unit()
    disturbed.receive(data + b"\r", 0.0)
    pan, tilt = disturbed.goal
    assert -3090 <= pan <= 3090
    assert -907 <= tilt <= 604


def test_bad_settings_are_refused() -> None:
    with pytest.raises(InputError, match="'slow' is unknown"):
        VirtualSerialPanTilt(faults=("slow",))
    with pytest.raises(InputError, match="must hold zero"):
        VirtualSerialPanTilt(UnitSettings(pan=(10, 20)))
    with pytest.raises(InputError, match="resolution"):
        VirtualSerialPanTilt(UnitSettings(resolution=(0.0, 1.0)))


def _exchange(
    driver: PanTiltDriver, link: SerialLink, port: PtyPort, core: VirtualSerialPanTilt
) -> int:
    """Poll both ends in turn until the driver is still; the number of turns."""
    now = 0.0
    for turn in range(2000):
        driver.poll(now)
        assert fill(port, link.sent, 2.0)
        port.poll(core, now)
        assert fill(link, port.sent, 2.0)
        now += 0.01
        if driver.status.still:
            return turn
    return -1


def test_on_a_pseudo_terminal_the_driver_cannot_tell() -> None:
    turns = []
    for _ in range(2):
        port, core = PtyPort(), VirtualSerialPanTilt()
        link = open_serial(port.device, 9600)
        driver = PanTiltDriver(link, PanTiltSite(), None, "left unit")
        driver.goto(1, 0.2, -0.1)
        turns.append(_exchange(driver, link, port, core))
        assert driver.status.number == 1
        assert core.goal == (223, -111)
        driver.close()
        port.close()
    # In turns and without a lost byte it is the same each time.
    assert turns[0] == turns[1] > 0


def test_one_port_is_for_one_driver() -> None:
    port = PtyPort()
    link = open_serial(port.device, 9600)
    with pytest.raises(HardwareError, match="does no other program hold it"):
        open_serial(port.device, 9600)
    link.close()
    link.close()
    again = open_serial(port.device, 9600)
    again.close()
    port.close()
    with pytest.raises(HardwareError, match="closed by this side"):
        again.read()
