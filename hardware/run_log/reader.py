"""Reading of a run log; the last line may be cut, as a killed run leaves it."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.run_log.writer import FORMAT, VERSION
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.planning.trajectory import AXES

#: Longest line of a record, bytes.
_LONGEST_LINE = 1 << 20


@dataclass(frozen=True)
class LogEvent:
    """A single event: time on the host's clock, s, one word, a sentence, plain values."""

    time: float
    kind: str
    text: str
    data: dict[str, Any]


@dataclass(frozen=True)
class LogStatus:
    """A recorded status of the driver: time on the host's clock, s, and its fields by name."""

    time: float
    fields: dict[str, Any]

    @property
    def state(self) -> str:
        """State of the driver."""
        return str(self.fields.get("state", ""))


@dataclass(frozen=True, eq=False)
class CommandedPoints:
    """Points sent.

    Attributes:
        times: (n,) of sending, host's clock, s.
        numbers: (n,) of the commands.
        sequences: (n,) of the points in their trajectories.
        point_times: (n,) on the trajectory's clock, s.
        positions: (n, 13) rad.
        velocities: (n, 13) rad/s.
    """

    times: Array
    numbers: NDArray[np.int64]
    sequences: NDArray[np.int64]
    point_times: Array
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class MeasuredJoints:
    """Joint feedback received; NaN for values that were not finite.

    Attributes:
        times: (n,) of recording, host's clock, s.
        stamps: (n,) controller's clock, s; NaN if it sends none.
        positions: (n, 13) rad.
        velocities: (n, 13) rad/s.
    """

    times: Array
    stamps: Array
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class RunLogRecords:
    """Content of a run log.

    Attributes:
        header: first line.
        commanded: points sent.
        measured: joint feedback.
        statuses: of the driver.
        events: in order.
        cut: whether the last line is cut, as a crash leaves it.
    """

    header: dict[str, Any]
    commanded: CommandedPoints
    measured: MeasuredJoints
    statuses: tuple[LogStatus, ...]
    events: tuple[LogEvent, ...]
    cut: bool

    @property
    def begin(self) -> float:
        """Begin, host's clock, s; the first recorded time if the header states none."""
        clock = self.header.get("clock")
        if isinstance(clock, int | float) and not isinstance(clock, bool):
            return float(clock)
        return min(self._ends(0), default=0.0)

    @property
    def end(self) -> float:
        """Last recorded time, host's clock, s; 0 for an empty log."""
        return max(self._ends(-1), default=0.0)

    def _ends(self, k: int) -> list[float]:
        arrays = (self.commanded.times, self.measured.times)
        found = [float(times[k]) for times in arrays if len(times)]
        for records in (self.statuses, self.events):
            if records:
                found.append(records[k].time)
        return found


def read_run_log(path: str | Path) -> RunLogRecords:
    """Read a run log.

    Raises:
        InputError: the file is missing, is not a run log, has another version, or is damaged before
            its last line; the message names the line.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            lines = stream.read().split(b"\n")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name or the folder") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    rest = lines.pop()  # empty after a whole last line
    reader = _Reader(path)
    for number, line in enumerate(lines, start=1):
        reader.take(number, line)
    if not lines:
        raise InputError(f"{path}: is no run log: it has no whole line")
    return reader.records(cut=bool(rest))


class _Reader:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._header: dict[str, Any] = {}
        self._commanded: list[tuple[float, int, int, float, list[float], list[float]]] = []
        self._measured: list[tuple[float, float, list[float], list[float]]] = []
        self._statuses: list[LogStatus] = []
        self._events: list[LogEvent] = []
        self._takers: dict[str, Callable[[float, dict[str, Any]], None]] = {
            "commanded": self._take_commanded,
            "measured": self._take_measured,
            "status": self._take_status,
            "event": self._take_event,
        }

    def take(self, number: int, line: bytes) -> None:
        try:
            if len(line) > _LONGEST_LINE:
                raise ValueError(f"{len(line)} bytes")
            record = json.loads(line)
            if not isinstance(record, dict):
                raise TypeError("no object")
            if number == 1:
                self._take_header(record)
                return
            self._takers[record["k"]](float(record["t"]), record)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(
                f"{self._path}: line {number} is damaged ({_short(error)}); only the last line of "
                "a log may be cut"
            ) from None

    def _take_header(self, record: dict[str, Any]) -> None:
        if record.get("format") != FORMAT:
            raise InputError(f"{self._path}: is no run log of `unwrinkle execute`")
        if record.get("format_version") != VERSION:
            raise InputError(
                f"{self._path}: run log version {record.get('format_version')}, this program reads "
                f"version {VERSION}"
            )
        self._header = record

    def _take_commanded(self, now: float, record: dict[str, Any]) -> None:
        numbers = (int(record["n"]), int(record["i"]), _number(record["s"]))
        self._commanded.append((now, *numbers, _axes(record["q"]), _axes(record["v"])))

    def _take_measured(self, now: float, record: dict[str, Any]) -> None:
        stamp = _number(record["stamp"])
        self._measured.append((now, stamp, _axes(record["q"]), _axes(record["v"])))

    def _take_status(self, now: float, record: dict[str, Any]) -> None:
        fields = {key: value for key, value in record.items() if key not in ("k", "t")}
        if not isinstance(fields["state"], str):
            raise TypeError("no state")
        self._statuses.append(LogStatus(now, fields))

    def _take_event(self, now: float, record: dict[str, Any]) -> None:
        data = record["data"]
        if not isinstance(data, dict):
            raise TypeError("data is no object")
        self._events.append(LogEvent(now, str(record["kind"]), str(record["text"]), data))

    def records(self, *, cut: bool) -> RunLogRecords:
        sent, seen = self._commanded, self._measured
        commanded = CommandedPoints(
            np.array([item[0] for item in sent], dtype=float),
            np.array([item[1] for item in sent], dtype=np.int64),
            np.array([item[2] for item in sent], dtype=np.int64),
            np.array([item[3] for item in sent], dtype=float),
            np.array([item[4] for item in sent], dtype=float).reshape(-1, AXES),
            np.array([item[5] for item in sent], dtype=float).reshape(-1, AXES),
        )
        measured = MeasuredJoints(
            np.array([item[0] for item in seen], dtype=float),
            np.array([item[1] for item in seen], dtype=float),
            np.array([item[2] for item in seen], dtype=float).reshape(-1, AXES),
            np.array([item[3] for item in seen], dtype=float).reshape(-1, AXES),
        )
        events, statuses = tuple(self._events), tuple(self._statuses)
        return RunLogRecords(self._header, commanded, measured, statuses, events, cut)


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _axes(values: Any) -> list[float]:
    if not isinstance(values, list) or len(values) != AXES:
        raise ValueError(f"needs {AXES} numbers")
    return [_number(value) for value in values]


def _short(error: Exception) -> str:
    """Describe why a line cannot be read, without its bytes."""
    return "no text; is it a run log?" if isinstance(error, UnicodeError) else repr(error)
