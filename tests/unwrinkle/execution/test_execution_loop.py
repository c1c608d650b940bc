"""The loop around the executor: instructions, pages, signals and exceptions."""

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from unwrinkle.execution.controls import (
    Instruction,
    KeyControls,
    LineControls,
    open_controls,
    parse_instruction,
    parse_key,
)
from unwrinkle.execution.loop import run_to_the_end
from unwrinkle.flattening.execution.state import Outcome
from unwrinkle.interrupts import StopSignals
from unwrinkle.models.errors import InputError

pytestmark = pytest.mark.alone


class Script:
    """Controls that return instructions at given times."""

    def __init__(self, bench: Any, said: dict[float, str]) -> None:
        self._bench, self._said = bench, dict(said)

    def read(self) -> Sequence[Instruction]:
        due = [when for when in self._said if self._bench.now >= when]
        texts = [self._said.pop(when) for when in due]
        return [found for text in texts if (found := parse_instruction(text)) is not None]


class FakePage:
    """Page that is closed at a given time."""

    def __init__(self, closes: float) -> None:
        self._closes = closes
        self.closed = False

    def update(self, now: float, text: str) -> Sequence[Instruction]:
        self.closed = now >= self._closes
        return ()


def looped(bench: Any, said: dict[float, str] | None = None, **options: object) -> list[str]:
    """Run the loop to its end; return the displayed messages."""
    told: list[str] = []

    def sleep(time: float) -> None:
        bench.driver.advance()
        bench.now += time
        assert bench.now < 60.0

    interrupts = options.pop("interrupts", None) or StopSignals()
    run_to_the_end(
        bench.executor,
        Script(bench, said or {}),
        interrupts,
        clock=lambda: bench.now,
        sleep=sleep,
        tell=options.pop("tell", told.append),
        **options,
    )
    return told


def test_the_loop_does_what_is_said(bench: Any) -> None:
    told = looped(bench, {0.2: "speed 0.25", 0.4: "hold", 1.0: "resume", 1.2: "speed 3"})
    words = [call[0] for call in bench.driver.calls]
    assert words[:5] == ["override", "run", "override", "hold", "resume"]
    assert any(text.startswith("refused: the speed is 3") for text in told)
    assert told[-1] == "done" or told[-1].startswith("coming to rest")


def test_what_is_not_understood_holds(bench: Any) -> None:
    looped(bench, {0.4: "stpo", 2.0: "stop"})
    assert [call[0] for call in bench.driver.calls] == [
        *("override", "run", "hold"),
        *("stop", "hold"),
    ]


def test_a_timed_instruction_waits(bench: Any) -> None:
    looped(bench, {0.0: "@0.5 stop"})
    assert 0.5 <= bench.now < 1.0
    assert bench.executor.result is not None and bench.executor.result.outcome == Outcome.STOPPED


def test_a_closed_page_holds_once(bench: Any) -> None:
    looped(bench, {2.0: "resume"}, page=FakePage(0.5))
    words = [call[0] for call in bench.driver.calls]
    assert words[: words.index("stop")].count("hold") == 1
    assert bench.executor.result is not None and bench.executor.result.outcome == Outcome.DONE


def test_a_signal_stops_it(bench: Any) -> None:
    interrupts = StopSignals()
    interrupts.name, interrupts.number = "SIGTERM", 15
    looped(bench, interrupts=interrupts)
    assert bench.executor.result is not None
    assert bench.executor.result.reason == "SIGTERM received"


def test_an_exception_stops_it_before_it_is_raised(bench: Any) -> None:
    def broken(closed: float = 0.0) -> None:
        raise ZeroDivisionError("a defect")

    bench.run(bench.during("approach"))
    bench.grippers.command = lambda number, closed: broken()
    with pytest.raises(ZeroDivisionError, match="a defect"):
        looped(bench)
    assert bench.executor.result is not None
    assert bench.executor.result.reason == "ZeroDivisionError: a defect"
    assert bench.driver.calls[-2][0] == "stop"


def test_a_terminal_that_is_gone_changes_nothing(bench: Any) -> None:
    def gone(text: str) -> None:
        raise OSError("Input/output error")

    looped(bench, tell=gone)
    assert bench.executor.result.outcome == Outcome.DONE


def test_signals_are_noted_while_the_robot_may_move(bench: Any) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with StopSignals() as interrupts:
        with pytest.raises(SystemExit) as stop:
            signal.raise_signal(signal.SIGTERM)
        assert stop.value.code == 128 + signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        interrupts.armed = True
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
        assert (interrupts.name, interrupts.number) == ("SIGTERM", signal.SIGTERM)
        looped(bench, interrupts=interrupts)
    assert signal.getsignal(signal.SIGTERM) is before
    assert bench.executor.result.outcome == Outcome.STOPPED


def test_a_second_signal_raises_where_computations_are_long() -> None:
    with StopSignals(armed=True, second_raises=True) as interrupts:
        signal.raise_signal(signal.SIGHUP)
        assert interrupts.name == "SIGHUP"
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


# ---------------------------------------------------------------- what can be said


def test_lines_come_in_any_pieces(tmp_path: Path) -> None:
    read, write = os.pipe()
    controls = LineControls(read)
    assert list(controls.read()) == []
    os.write(write, b"ho")
    assert list(controls.read()) == []
    os.write(write, b"ld\n\nspeed 0.5\nres")
    assert [said.word for said in controls.read()] == ["hold", "speed"]
    os.write(write, b"ume")
    os.close(write)
    words = [said.word for _ in range(3) for said in controls.read()]
    assert words == ["resume"] and controls.ended
    os.close(read)


def test_a_line_without_end_is_refused() -> None:
    read, write = os.pipe()
    os.write(write, b"x" * 300)
    with pytest.raises(InputError, match="more than 200 characters"):
        LineControls(read).read()
    os.close(read)
    os.close(write)


def test_controls_come_from_a_file_or_a_named_pipe(tmp_path: Path) -> None:
    (tmp_path / "said").write_text("stop")
    with open_controls(str(tmp_path / "said")) as controls:
        assert [said.word for _ in range(2) for said in controls.read()] == ["stop"]
    os.mkfifo(tmp_path / "pipe")
    with open_controls(str(tmp_path / "pipe")) as controls:
        assert list(controls.read()) == []
        for word in ("hold", "resume"):  # each writer connects and disconnects
            with open(tmp_path / "pipe", "w") as writer:
                writer.write(word + "\n")
            assert [said.word for said in controls.read()] == [word]
    with (
        pytest.raises(InputError, match="cannot be read"),
        open_controls(str(tmp_path / "none")) as controls,
    ):
        pytest.fail("no such file")


def test_keys_of_a_terminal() -> None:
    ours, theirs = os.openpty()
    os.write(ours, b"h+ 0x\n")
    said = list(KeyControls(theirs).read())
    assert [(i.word, i.value, i.change) for i in said] == [
        ("hold", 0.0, False),
        ("speed", 0.05, True),
        ("alive", 0.0, False),
        ("speed", 1.0, False),
    ]
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("hold", Instruction("hold")),
        (" speed 0.25  # slower", Instruction("speed", 0.25)),
        ("@1.5 resume", Instruction("resume", at=1.5)),
        ("", None),
        ("# nothing", None),
    ],
)
def test_lines(line: str, wanted: Instruction | None) -> None:
    assert parse_instruction(line) == wanted


@pytest.mark.parametrize("line", ["go", "speed", "speed fast", "hold 3", "@x hold", "@1"])
def test_lines_that_say_nothing_known(line: str) -> None:
    with pytest.raises(InputError, match=r"no command|no number"):
        parse_instruction(line)


@pytest.mark.parametrize(
    ("key", "word", "value"),
    [("h", "hold", 0), ("s", "stop", 0), (" ", "alive", 0), ("3", "speed", 0.3), ("0", "speed", 1)],
)
def test_keys(key: str, word: str, value: float) -> None:
    assert parse_key(key) == Instruction(word, value)


def test_other_keys_mean_nothing() -> None:
    assert parse_key("x") is None and parse_key("") is None and parse_key("²") is None
