"""The run log: what is written is read; a cut last line is tolerated, other damage is named."""

import errno
import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback, RobotStatus
from unwrinkle.hardware.run_log import writer
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import InputError

Q, V = np.linspace(-1.0, 1.0, 13), np.linspace(0.5, -0.5, 13)


def feedback(shift: float = 0.0, stamp: float | None = None) -> JointFeedback:
    return JointFeedback(Q + shift, V, 1.0, stamp, 3)


def write(path: Path) -> bytes:
    """A log with a record of each kind; its bytes."""
    with RunLog.create(path, {"site": "here", "clock": 1.0}) as log:
        log.event(1.0, "connect", "to the controller", port=50240)
        log.measured(1.025, feedback(stamp=7.5))
        log.commanded(1.03, 4, 0, 0.0, Q, V)
        log.commanded(1.04, 4, 1, 0.008, Q + 0.1, V)
        log.status(1.05, DriverStatus("running", 4, robot=RobotStatus(1, 0, 0, 0, 1, 2, 1)))
    return path.read_bytes()


def test_what_is_written_comes_back_bit_for_bit(tmp_path: Path) -> None:
    write(tmp_path / "a.jsonl")
    records = read_run_log(tmp_path / "a.jsonl")
    assert records.header["site"] == "here"
    assert not records.cut
    assert records.commanded.numbers.tolist() == [4, 4]
    assert records.commanded.sequences.tolist() == [0, 1]
    np.testing.assert_array_equal(records.commanded.positions, [Q, Q + 0.1])
    np.testing.assert_array_equal(records.commanded.point_times, [0.0, 0.008])
    np.testing.assert_array_equal(records.measured.velocities, [V])
    assert records.measured.stamps.tolist() == [7.5]
    assert records.statuses[0].state == "running"
    assert records.statuses[0].fields["robot"]["mode"] == 2
    assert records.statuses[0].fields["feedback_age"] is None  # infinite
    assert (records.events[0].kind, records.events[0].data) == ("connect", {"port": 50240})
    assert (records.begin, records.end) == (1.0, 1.05)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 1.0))
def test_a_log_cut_anywhere_is_read_up_to_the_cut(
    tmp_path_factory: pytest.TempPathFactory, share: float
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    whole = write(folder / "whole.jsonl")
    first = whole.index(b"\n") + 1
    size = first + round(share * (len(whole) - first))
    (folder / "cut.jsonl").write_bytes(whole[:size])
    records = read_run_log(folder / "cut.jsonl")
    count = sum(
        map(
            len, (records.commanded.times, records.measured.times, records.statuses, records.events)
        )
    )
    assert count == whole[:size].count(b"\n") - 1
    assert records.cut == (whole[size - 1 : size] != b"\n")


@pytest.mark.parametrize(
    "damage",
    [b"{", b"[]", b'{"k":"measured","t":1}', b'{"k":"other","t":1}', b"\xff\xfe", b'{"t":1}', b""],
)
def test_damage_inside_names_the_line(tmp_path: Path, damage: bytes) -> None:
    lines = write(tmp_path / "a.jsonl").split(b"\n")
    lines[2] = damage
    (tmp_path / "b.jsonl").write_bytes(b"\n".join(lines))
    with pytest.raises(InputError, match="line 3 is damaged"):
        read_run_log(tmp_path / "b.jsonl")


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "no whole line"),
        (b'{"format":"other"}\n', "is no run log"),
        (b'{"format":"unwrinkle-run-log","format_version":9}\n', "version 9"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, text: str) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match=text):
        read_run_log(tmp_path / "a")
    with pytest.raises(InputError, match="no such file"):
        read_run_log(tmp_path / "missing")


def test_a_log_is_never_written_over(tmp_path: Path) -> None:
    before = write(tmp_path / "a.jsonl")
    with pytest.raises(InputError, match="there is a log already"):
        RunLog.create(tmp_path / "a.jsonl", {})
    assert (tmp_path / "a.jsonl").read_bytes() == before


def test_numbers_that_json_lacks_come_back_as_nan(tmp_path: Path) -> None:
    broken = Q.copy()
    broken[3] = np.nan
    with RunLog.create(tmp_path / "a.jsonl", {}) as log:
        log.measured(1.0, JointFeedback(broken, V, 1.0))
        log.event(1.1, "refused", "not finite", value=np.inf)
    records = read_run_log(tmp_path / "a.jsonl")
    assert np.isnan(records.measured.positions[0, 3])
    assert np.isfinite(np.delete(records.measured.positions[0], 3)).all()
    assert records.events[0].data == {"value": None}


def test_a_line_is_there_before_the_log_is_closed(tmp_path: Path) -> None:
    log = RunLog.create(tmp_path / "a.jsonl", {})
    log.event(1.0, "connect", "yes")
    assert len(read_run_log(tmp_path / "a.jsonl").events) == 1
    log.close()
    log.close()
    with pytest.raises(OSError, match="closed"):
        log.event(2.0, "late", "no")


def test_status_that_only_goes_on_is_thinned(tmp_path: Path) -> None:
    with RunLog.create(tmp_path / "a.jsonl", {}) as log:
        for k in range(50):
            log.status(0.01 * k, DriverStatus("running", progress=0.01 * k, points=k))
        log.status(0.5, DriverStatus("fault", reason="silent"))
    statuses = read_run_log(tmp_path / "a.jsonl").statuses
    assert 4 <= len(statuses) <= 7
    assert statuses[-1].state == "fault"


def test_a_full_disk_raises_and_leaves_whole_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.jsonl"
    log = RunLog.create(path, {})
    log.event(1.0, "before", "there is room")
    room = [20]
    plain = os.write

    def full(descriptor: int, data: bytes) -> int:
        if not room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = plain(descriptor, bytes(data)[: room[0]])
        room[0] -= count
        return count

    monkeypatch.setattr(writer.os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        log.event(2.0, "during", "there is none")
    monkeypatch.undo()
    log.event(3.0, "after", "there is room again")
    log.close()
    records = read_run_log(path)
    assert [event.kind for event in records.events] == ["before", "after"]
    assert not records.cut


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        RunLog.create(tmp_path / "file" / "a.jsonl", {})


def test_many_threads_write_whole_lines(tmp_path: Path) -> None:
    with RunLog.create(tmp_path / "a.jsonl", {}) as log:

        def work(name: int) -> None:
            for k in range(100):
                log.event(float(k), "tick", "x" * 200, name=name)

        threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(read_run_log(tmp_path / "a.jsonl").events) == 400
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    assert all(json.loads(line) for line in lines)
