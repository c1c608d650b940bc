"""One owner for one robot: a lock on a file that names who holds it."""

import fcntl
import json
import os
import re
import sys
import tempfile
import time
from io import TextIOWrapper
from pathlib import Path

from unwrinkle.models.errors import HardwareError


def lock_directory() -> Path:
    """Where locks live: the user's runtime directory, or the system's for temporary files."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(runtime) if runtime and Path(runtime).is_dir() else Path(tempfile.gettempdir())


class OwnerLock:
    """Held by the one process that commands a robot; the system frees it when the process ends, however it ends."""

    def __init__(
        self, host: str, port: int, command: str = "", directory: Path | None = None
    ) -> None:
        """Name the lock by the robot's address.

        Args:
            host, port: of the robot's motion server.
            command: of the owner, for others to read; the command line if empty.
            directory: of the lock's file; the default is `lock_directory`.
        """
        name = re.sub(r"[^A-Za-z0-9.]+", "-", host)
        self.path = (directory or lock_directory()) / f"unwrinkle-{name}-{port}.lock"
        self._what = f"{host}:{port}"
        self._command = command or " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
        self._file: TextIOWrapper | None = None

    @property
    def held(self) -> bool:
        """Whether this object holds it."""
        return self._file is not None

    def acquire(self) -> None:
        """Take the lock, or refuse; a second time changes nothing.

        Raises:
            HardwareError: another one owns the robot (process, command, since when), or the file cannot be written.
        """
        if self._file is not None:
            return
        try:
            file = open(self.path, "a+", encoding="utf-8")  # noqa: SIM115 - held until released
        except OSError as error:
            raise HardwareError(
                f"the lock of the robot at {self._what} cannot be opened: {self.path}: {error.strerror}; "
                "set XDG_RUNTIME_DIR to a folder of yours"
            ) from None
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            owner = _owner(file)
            file.close()
            raise HardwareError(
                f"the robot at {self._what} is in use: {owner}; end that first (lock file {self.path})"
            ) from None
        file.truncate(0)
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        json.dump({"pid": os.getpid(), "command": self._command, "since": since}, file)
        file.flush()
        self._file = file

    def release(self) -> None:
        """Give the lock back; without it nothing happens. The file stays, empty."""
        if self._file is None:
            return
        self._file.truncate(0)
        self._file.close()
        self._file = None


def _owner(file: TextIOWrapper) -> str:
    """Who wrote the file, in words."""
    try:
        file.seek(0)
        owner = json.loads(file.read(4096))
        return f"process {owner['pid']} ({owner['command']}) since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "by a process that left no name"
