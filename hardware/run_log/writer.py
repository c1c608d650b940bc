"""The run log: one JSON object per line, append-only, readable after a crash.

The first line is the header; every further line has the kind of record (`k`) and the host's
monotonic time (`t`, s):

- `commanded`: n (command), i (sequence), s (time on the trajectory's clock), q, v (13 each);
- `measured`: q, v (13 each), stamp (controller's clock or null), count, at (time of reception);
- `status`: the driver's status, where it has changed, and ten times a second while it only goes on;
- `event`: kind, text, data.

A number that is not finite is written as null. Each line is handed to the operating system at once,
so that it survives the end of the program. A thread of its own synchronises the file with the disk,
which can take long: at every event and each second.
"""

import dataclasses as dc
import datetime
import json
import math
import os
import threading
import time as clock
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.models.errors import HardwareError, InputError

FORMAT = "unwrinkle-run-log"
VERSION = 1
#: Between two synchronisations with the disk, s.
SYNC_PERIOD = 1.0
#: Least time between two records of a status in which only running numbers have changed, s.
STATUS_PERIOD = 0.1
#: Fields of a status that change continuously.
_RUNNING_NUMBERS = ("progress", "feedback_age", "points", "following_error", "lag")


class RunLog:
    """A run log that is being written, from any thread."""

    def __init__(self, descriptor: int, path: Path) -> None:
        """Write to an open file, which the log closes; see `create`."""
        self.path = path
        self._descriptor = descriptor
        self._lock = threading.Lock()
        self._problem = ""
        self._last: tuple[DriverStatus, float] | None = None
        self._wake = threading.Event()
        self._closed = False
        self._syncer = threading.Thread(target=self._sync, name="run log", daemon=True)
        self._syncer.start()

    @classmethod
    def create(cls, path: str | Path, header: Mapping[str, Any]) -> "RunLog":
        """Create a log.

        Args:
            path: of the file, which must not exist; missing folders are created.
            header: description of the run: version, site, hash of the plan, verdict; plain values.

        Raises:
            InputError: the file exists, or cannot be written.
        """
        path = Path(path)
        try:
            if not path.parent.is_dir():
                path.parent.mkdir(parents=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            log = cls(os.open(path, flags, 0o644), path)
        except OSError as error:
            if path.exists():
                raise InputError(f"{path}: there is a log already; name a new file") from None
            raise InputError(
                f"{path}: the run log cannot be written ({error.strerror or error}); name a file "
                "in a folder that can"
            ) from None
        first = {
            "format": FORMAT,
            "format_version": VERSION,
            "begun": datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds"),
            "clock": clock.monotonic(),
            **header,
        }
        try:
            log._write(first, keep=True)
        except OSError as error:
            log.close()
            raise InputError(
                f"{path}: the run log cannot be written ({error.strerror or error}); make room, "
                "or name a file elsewhere"
            ) from None
        return log

    @classmethod
    def join(cls, path: str | Path) -> "RunLog":
        """Append to a log that another process has created; records of both are written whole.

        Raises:
            HardwareError: the file cannot be opened.
        """
        try:
            return cls(os.open(path, os.O_WRONLY | os.O_APPEND), Path(path))
        except OSError as error:
            raise HardwareError(
                f"{path}: the run log cannot be joined ({error.strerror or error})"
            ) from None

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        """See `RunLogger.commanded`."""
        q, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
        record = {"k": "commanded", "t": now, "n": number, "i": sequence, "s": time}
        self._write({**record, "q": q.tolist(), "v": v.tolist()})

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """See `RunLogger.measured`."""
        self._write(
            {
                "k": "measured",
                "t": now,
                "q": feedback.positions.tolist(),
                "v": feedback.velocities.tolist(),
                "stamp": feedback.stamp,
                "count": feedback.count,
                "at": feedback.received,
            }
        )

    def status(self, now: float, status: DriverStatus) -> None:
        """See `RunLogger.status`; skipped if only running numbers have changed within
        `STATUS_PERIOD`.
        """
        if self._last is not None:
            last, when = self._last
            running = {name: getattr(last, name) for name in _RUNNING_NUMBERS}
            if now - when < STATUS_PERIOD and dc.replace(status, **running) == last:
                return
        self._write({"k": "status", "t": now, **dc.asdict(status)})
        self._last = (status, now)

    def event(self, now: float, kind: str, text: str, **data: Any) -> None:
        """See `RunLogger.event`."""
        self._write({"k": "event", "t": now, "kind": kind, "text": text, "data": data}, keep=True)

    def close(self) -> None:
        """Synchronise with the disk and close; a second call changes nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._wake.set()
        self._syncer.join()
        with suppress(OSError):
            os.fsync(self._descriptor)
        with suppress(OSError):
            os.close(self._descriptor)

    def __enter__(self) -> Self:
        """Return the log itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def _write(self, record: Mapping[str, Any], *, keep: bool = False) -> None:
        """Append a line, whole or not at all.

        Raises:
            OSError: the line cannot be written; a part of it is removed again.
        """
        line = json.dumps(_finite(record), separators=(",", ":"), default=_plain).encode() + b"\n"
        with self._lock:
            if self._closed:
                raise OSError(f"{self.path}: the run log is closed")
            if self._problem:
                raise OSError(self._problem)
            rest = memoryview(line)
            try:
                while rest:
                    rest = rest[os.write(self._descriptor, rest) :]
            except OSError:
                written = len(line) - len(rest)
                with suppress(OSError):
                    end = os.fstat(self._descriptor).st_size
                    os.ftruncate(self._descriptor, end - written)
                raise
        if keep:
            self._wake.set()

    def _sync(self) -> None:
        while not self._closed:
            self._wake.wait(SYNC_PERIOD)
            self._wake.clear()
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                # EINVAL, ENOTSUP: devices and pipes cannot be synchronised, and need not be.
                if error.errno not in (22, 95):
                    self._problem = (
                        f"{self.path}: the disk does not keep the run log ({error.strerror})"
                    )
                return


def _finite(value: Any) -> Any:
    """Return the value with None in place of numbers that are not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return str(value)
