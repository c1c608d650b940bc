"""Folder of a run: everything observed, planned and executed, readable whenever the run ends.

Every file is written atomically; `events.jsonl` grows by one line per event. A look's folder is
complete when its `action.json` exists, which is written last.
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
#: Possible statuses of a run.
STATUSES = (RUNNING, "flat", "stopped", "fault", "interrupted")
_FORMAT = "unwrinkle.run"
_VERSION = 1
_RUN = "run.json"
_SCENARIO = "scenario.yaml"
_EVENTS = "events.jsonl"
_CLOTH = "cloth.npz"
_DISTRIBUTIONS = ("unwrinkle", "drake", "numpy", "scipy", "numba", "opencv-python-headless")


@dataclass(frozen=True)
class Event:
    """One line of `events.jsonl`.

    Attributes:
        number: number of the event, from 0.
        time: time of the station's clock, s.
        wall: UTC, ISO 8601.
        state: state of the supervisor.
        text: what happened.
        data: further data, as JSON.
    """

    number: int
    time: float
    wall: str
    state: str
    text: str
    data: Mapping[str, Any]


class RunFolder:
    """Run on disk: `create` a new one, or `open` an existing one."""

    def __init__(self, path: Path, record: dict[str, Any]) -> None:
        """Keep a folder and the content of its `run.json`; use `create` or `open` instead."""
        self.path = path
        self._record = record
        self.settings = RunSettings.from_json(record["settings"])
        self._next: int | None = None

    @classmethod
    def create(cls, path: str | Path, settings: RunSettings) -> "RunFolder":
        """Create the folder of a new run.

        Raises:
            InputError: the folder holds a run already, is a file, or cannot be written.
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
        """Refuse a folder that cannot hold a new run.

        Raises:
            InputError: it holds a run already, or is a file.
        """
        if path.exists() and not path.is_dir():
            raise InputError(f"{path}: is a file; name a folder for the run")
        if (path / _RUN).exists():
            raise InputError(f"{path}: holds a run already; name another folder, or resume the run")

    @classmethod
    def open(cls, path: str | Path) -> "RunFolder":
        """Read the folder of a run.

        Raises:
            InputError: it holds no run, or its `run.json` is damaged.
        """
        path = Path(path)
        if not path.is_dir():
            raise InputError(f"{path}: no such folder; give the folder of a run")
        file = path / _RUN
        if not file.is_file():
            raise InputError(
                f"{path}: {_RUN} is missing, so this is no run; give the folder of a run"
            )
        record = read_json(file)
        if record.get("format") != _FORMAT or record.get("version") != _VERSION:
            raise InputError(
                f"{file}: is no run of version {_VERSION}; it was written by another version"
            )
        if record.get("status") not in STATUSES or not isinstance(record.get("figures"), dict):
            raise InputError(f"{file}: is damaged: the status or the figures are missing")
        try:
            return cls(path, record)
        except (InputError, KeyError) as error:
            raise InputError(f"{file}: is damaged: {error}") from None

    @property
    def status(self) -> str:
        """Return one of `STATUSES`; also "running" for a run that was killed."""
        return str(self._record["status"])

    @property
    def reason(self) -> str:
        """Return why the run ended."""
        return str(self._record.get("reason", ""))

    @property
    def figures(self) -> dict[str, Any]:
        """Return the figures of the whole run; empty before its end."""
        return dict(self._record["figures"])

    @property
    def record(self) -> dict[str, Any]:
        """Return the content of `run.json`."""
        return dict(self._record)

    @property
    def scenario_file(self) -> Path | None:
        """Return the run's scenario file; None if it was not written."""
        path = self.path / _SCENARIO
        return path if self.settings.scenario and path.is_file() else None

    def look(self, index: int) -> LookFolder:
        """Return the folder of a look by its index, from 0.

        Raises:
            InputError: the index is negative.
        """
        if index < 0:
            raise InputError(f"look {index}: the index is negative; looks are numbered from 0")
        return LookFolder(self.path / f"{index:03d}", index)

    def looks(self) -> list[LookFolder]:
        """Return all looks that have a folder, in order."""
        indices = sorted(
            int(entry.name)
            for entry in self.path.iterdir()
            if entry.is_dir() and entry.name.isascii() and entry.name.isdigit()
        )
        return [look for look in map(self.look, indices) if look.exists]

    def last_complete(self) -> int | None:
        """Return the index of the last look up to which every action was recorded.

        It is None if there is none.
        """
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
        """Return all events; incomplete lines are skipped."""
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
        """Return the triangles (m, 3) of the cloth and its vertices in the flat cloth, (n, 2) m.

        Raises:
            InputError: they were not written.
        """
        _, arrays = load_archive(self.path / _CLOTH, "triangles|rest")
        try:
            return arrays["triangles"], arrays["rest"]
        except KeyError as error:
            raise InputError(f"{self.path / _CLOTH}: {error} is missing") from None

    def save_cloth(self, triangles: NDArray[Any], rest: NDArray[Any]) -> None:
        """Write the cloth's mesh, which the replay needs.

        Triangles (m, 3), vertices in the flat cloth (n, 2), m.

        Raises:
            InputError: shapes disagree, or the file cannot be written.
        """
        t, r = np.asarray(triangles), np.asarray(rest)
        if t.ndim != 2 or t.shape[1] != 3 or r.ndim != 2 or r.shape[1] != 2 or t.max() >= len(r):
            raise InputError(f"cloth mesh: triangles {t.shape} and rest {r.shape} do not match")
        arrays = {"triangles": t.astype(np.int32), "rest": r.astype(np.float32)}
        save_archive(self.path / _CLOTH, {"format": "unwrinkle.cloth-mesh"}, arrays)

    def event(
        self, time: float, state: str, text: str, data: Mapping[str, Any] | None = None
    ) -> Event:
        """Append an event and flush it: it is on disk when this returns.

        Args:
            time: time of the station's clock, s.
            state: state of the supervisor.
            text: what happened.
            data: further data; plain JSON.

        Raises:
            InputError: the data cannot be written as JSON, or the file cannot be written.
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
        """Write the result of the run.

        Raises:
            InputError: the status is unknown, a figure cannot be written as JSON, or the file
                cannot be written.
        """
        if status not in STATUSES:
            raise InputError(f"run status {status!r} is unknown; known are {', '.join(STATUSES)}")
        self._write(
            status=status,
            reason=reason,
            finished=None if status == RUNNING else _now(),
            figures={**self.figures, **dict(figures or {})},
        )

    def resume(self) -> None:
        """Mark the run as running again after it ended or was killed.

        Raises:
            InputError: the file cannot be written.
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
    """Return the command line of this process, with the program's name instead of its path."""
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
    """Append to a file and flush; an incomplete last line is terminated first."""
    try:
        with path.open("ab+") as stream:
            if text and stream.tell() > 0:
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")
            stream.write(text.encode("utf-8"))
            stream.flush()
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error}; free disk space, or change the file's permissions"
        ) from None
