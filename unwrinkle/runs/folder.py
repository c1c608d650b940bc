"""The folder of a run: everything that was seen, planned and done, readable whenever the run ends.

Every file appears whole or not at all; `events.jsonl` grows by a line per event. A look's folder is complete when
its `action.json` is there, which is written last.
"""

import datetime
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.io.files import write_json, write_text
from unwrinkle.runs.look_folder import LookFolder, read_json
from unwrinkle.runs.records import ActionRecord, MotionRecord, RunSettings, SegmentMark

__all__ = [
    "ActionRecord",
    "Event",
    "LookFolder",
    "MotionRecord",
    "RunFolder",
    "RunSettings",
    "SegmentMark",
    "command_line",
]

RUNNING = "running"
#: How a run can stand.
STATUSES = (RUNNING, "flat", "stopped", "fault", "interrupted")
_FORMAT, _VERSION = "unwrinkle.run", 1
_RUN, _SCENARIO, _EVENTS, _CLOTH = "run.json", "scenario.yaml", "events.jsonl", "cloth.npz"
_DISTRIBUTIONS = ("unwrinkle", "drake", "numpy", "scipy", "numba", "opencv-python-headless")


@dataclass(frozen=True)
class Event:
    """One line of `events.jsonl`.

    Attributes:
        number: counts from 0.
        time: on the station's clock, s.
        wall: UTC, ISO 8601.
        state: of the supervisor.
        text: what happened.
        data: more of it, as JSON.
    """

    number: int
    time: float
    wall: str
    state: str
    text: str
    data: Mapping[str, Any]


class RunFolder:
    """A run on the disk: `create` a new one, or `open` one that is there."""

    def __init__(self, path: Path, record: dict[str, Any]) -> None:
        """Take a folder and the content of its `run.json`; use `create` or `open`."""
        self.path = path
        self._record = record
        self.settings = RunSettings.from_json(record["settings"])
        self._next: int | None = None

    @classmethod
    def create(cls, path: str | Path, settings: RunSettings) -> "RunFolder":
        """Make the folder of a new run.

        Raises:
            InputError: there is a run already, it is a file, or it cannot be written.
        """
        path = Path(path)
        cls.check_free(path)
        record = {
            "format": _FORMAT,
            "version": _VERSION,
            "status": RUNNING,
            "reason": "",
            "created": _now(),
            "finished": None,
            "settings": settings.to_json(),
            "versions": _versions(),
            "machine": _machine(),
            "figures": {},
        }
        write_text(path / _SCENARIO, settings.scenario)
        write_json(path / _RUN, record)
        run = cls(path, record)
        _append(path / _EVENTS, "")
        return run

    @staticmethod
    def check_free(path: Path) -> None:
        """Refuse a folder that a new run cannot have.

        Raises:
            InputError: there is a run already, or it is a file.
        """
        if path.exists() and not path.is_dir():
            raise InputError(f"{path}: is a file; name a folder for the run")
        if (path / _RUN).exists():
            raise InputError(f"{path}: holds a run already; name another folder, or go on with it")

    @classmethod
    def open(cls, path: str | Path) -> "RunFolder":
        """Read the folder of a run.

        Raises:
            InputError: it is none, or its `run.json` is damaged.
        """
        path = Path(path)
        if not path.is_dir():
            raise InputError(f"{path}: no such folder; give the folder of a run")
        file = path / _RUN
        if not file.is_file():
            raise InputError(f"{path}: is no run, {_RUN} is missing; give the folder of a run")
        record = read_json(file)
        if record.get("format") != _FORMAT or record.get("version") != _VERSION:
            raise InputError(f"{file}: is no run of version {_VERSION}")
        if record.get("status") not in STATUSES or not isinstance(record.get("figures"), dict):
            raise InputError(f"{file}: is damaged: its status or its figures are missing")
        try:
            return cls(path, record)
        except (InputError, KeyError) as error:
            raise InputError(f"{file}: is damaged: {error}") from None

    # ------------------------------------------------------------ what it says

    @property
    def status(self) -> str:
        """One of `STATUSES`; "running" also for a run that was killed."""
        return str(self._record["status"])

    @property
    def reason(self) -> str:
        """Why the run ended as it did."""
        return str(self._record.get("reason", ""))

    @property
    def figures(self) -> dict[str, Any]:
        """Figures of the whole run; empty before its end."""
        return dict(self._record["figures"])

    @property
    def record(self) -> dict[str, Any]:
        """Everything in `run.json`."""
        return dict(self._record)

    @property
    def scenario_file(self) -> Path | None:
        """The run's scenario; None where it was not written down."""
        path = self.path / _SCENARIO
        return path if self.settings.scenario and path.is_file() else None

    def look(self, index: int) -> LookFolder:
        """The folder of the index-th look, from 0.

        Raises:
            InputError: the index is negative.
        """
        if index < 0:
            raise InputError(f"look {index}: looks are counted from 0")
        return LookFolder(self.path / f"{index:03d}", index)

    def looks(self) -> list[LookFolder]:
        """All looks that have a folder, in order."""
        indices = sorted(
            int(entry.name)
            for entry in self.path.iterdir()
            if entry.is_dir() and entry.name.isascii() and entry.name.isdigit()
        )
        return [look for look in map(self.look, indices) if look.exists]

    def last_complete(self) -> int | None:
        """Index of the last look before which, itself included, every action was recorded; None without any."""
        last = None
        for index, look in enumerate(self.looks()):
            if look.index != index:
                break
            try:
                look.action()
            except InputError:
                break
            last = index
        return last

    def events(self) -> list[Event]:
        """All events; a line that was cut off is left out."""
        try:
            lines = (self.path / _EVENTS).read_text(encoding="utf-8", errors="replace").split("\n")
        except OSError:
            return []
        found = []
        for line in lines:
            with suppress(ValueError, TypeError):
                found.append(Event(**json.loads(line)))
        return found

    def cloth(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Triangles (m, 3) of the cloth's vertices and where these lie in the flat cloth, (n, 2) m.

        Raises:
            InputError: they were not written.
        """
        _, arrays = load_archive(self.path / _CLOTH, "triangles|rest")
        try:
            return arrays["triangles"], arrays["rest"]
        except KeyError as error:
            raise InputError(f"{self.path / _CLOTH}: {error} is missing") from None

    # ------------------------------------------------------------ writing

    def save_cloth(self, triangles: NDArray[Any], rest: NDArray[Any]) -> None:
        """Write the cloth's mesh: triangles (m, 3), and the vertices' place in the flat cloth (n, 2), m.

        The replay needs it to show the cloth.

        Raises:
            InputError: shapes disagree, or it cannot be written.
        """
        t, r = np.asarray(triangles), np.asarray(rest)
        if t.ndim != 2 or t.shape[1] != 3 or r.ndim != 2 or r.shape[1] != 2 or t.max() >= len(r):
            raise InputError(f"cloth mesh: triangles {t.shape} and rest {r.shape} do not fit")
        arrays = {"triangles": t.astype(np.int32), "rest": r.astype(np.float32)}
        save_archive(self.path / _CLOTH, {"format": "unwrinkle.cloth-mesh"}, arrays)

    def event(
        self, time: float, state: str, text: str, data: Mapping[str, Any] | None = None
    ) -> Event:
        """Append an event and flush it: it is on the disk when this returns.

        Args:
            time: on the station's clock, s.
            state: of the supervisor.
            text: what happened.
            data: more of it; plain JSON.

        Raises:
            InputError: the data has no form in JSON, or the file cannot be written.
        """
        if self._next is None:
            self._next = 1 + max((event.number for event in self.events()), default=-1)
        event = Event(self._next, float(time), _now(), state, text, dict(data or {}))
        try:
            line = json.dumps(event.__dict__, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InputError(f"event '{text}': {error}") from None
        _append(self.path / _EVENTS, line + "\n")
        self._next += 1
        return event

    def finish(
        self, status: str, reason: str = "", figures: Mapping[str, Any] | None = None
    ) -> None:
        """Write how the run ended.

        Raises:
            InputError: an unknown status, a figure that has no form in JSON, or it cannot be written.
        """
        if status not in STATUSES:
            raise InputError(f"run status {status!r}: one of {', '.join(STATUSES)}")
        self._write(
            status=status,
            reason=reason,
            finished=None if status == RUNNING else _now(),
            figures={**self.figures, **dict(figures or {})},
        )

    def go_on(self) -> None:
        """Note that the run goes on after it ended or was killed.

        Raises:
            InputError: it cannot be written.
        """
        self.finish(RUNNING)

    def _write(self, **changes: Any) -> None:
        record = {**self._record, **changes}
        try:
            write_json(self.path / _RUN, record)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path / _RUN}: {error}") from None
        self._record = record


def command_line() -> str:
    """The line that started this process, with the program's name in place of its path."""
    name = Path(sys.argv[0]).name
    return shlex.join(["unwrinkle" if name == "__main__.py" else name, *sys.argv[1:]])


def _now() -> str:
    return datetime.datetime.fromtimestamp(time.time(), datetime.UTC).isoformat("T", "seconds")


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def _machine() -> dict[str, Any]:
    return {"system": platform.system(), "machine": platform.machine(), "cores": os.cpu_count()}


def _append(path: Path, text: str) -> None:
    """Append to a file and flush; a line that was cut off before is ended first."""
    try:
        with path.open("ab+") as stream:
            if text and stream.tell() > 0:
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")
            stream.write(text.encode("utf-8"))
            stream.flush()
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}; free some room, or its rights") from None
