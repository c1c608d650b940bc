"""A lock file per robot, so that one process commands it; the file names that process."""

import fcntl
import json
import os
import re
import sys
import tempfile
import time
from io import TextIOWrapper
from pathlib import Path

from unwrinkle.models.errors import HardwareError, InUseError


def lock_directory() -> Path:
    """Return the folder of lock files: the user's runtime directory, or the system's folder of
    temporary files.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(runtime) if runtime and Path(runtime).is_dir() else Path(tempfile.gettempdir())


class OwnerLock:
    """Held by the process that commands a robot; the operating system releases it when the process
    ends for any reason.
    """

    def __init__(
        self, host: str, port: int, command: str = "", directory: Path | None = None
    ) -> None:
        """Name the lock after the robot's address; `acquire` takes it.

        Args:
            host, port: of the robot's motion server.
            command: of the owner, shown to other programs; the command line if empty.
            directory: of the lock file; None is `lock_directory`.
        """
        name = re.sub(r"[^A-Za-z0-9.]+", "-", host)
        self.path = (directory or lock_directory()) / f"unwrinkle-{name}-{port}.lock"
        self._what = f"{host}:{port}"
        self._command = command or " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
        self._file: TextIOWrapper | None = None

    @property
    def held(self) -> bool:
        """Whether this object holds the lock."""
        return self._file is not None

    def acquire(self) -> None:
        """Take the lock; a second call changes nothing.

        Raises:
            InUseError: another process owns the robot (process, command, since when).
            HardwareError: the file cannot be opened.
        """
        if self._file is not None:
            return
        file = self._open()
        while not self._take(file):  # its owner has just removed it: open the new one
            file.close()
            file = self._open()
        file.truncate(0)
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        json.dump({"pid": os.getpid(), "command": self._command, "since": since}, file)
        file.flush()
        self._file = file

    def release(self) -> None:
        """Release the lock, if it is held, and remove its file."""
        if self._file is None:
            return
        self.path.unlink(missing_ok=True)  # still locked: who opens it now finds a new file
        self._file.close()
        self._file = None

    def _open(self) -> TextIOWrapper:
        try:
            return open(self.path, "a+", encoding="utf-8")  # held until released
        except OSError as error:
            raise HardwareError(
                f"the lock of the robot at {self._what} cannot be opened: {self.path}: "
                f"{error.strerror}; set XDG_RUNTIME_DIR to a folder of yours"
            ) from None

    def _take(self, file: TextIOWrapper) -> bool:
        """Lock an open file; return whether it is still the one at the path."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            owner = _owner(file)
            file.close()
            raise InUseError(
                f"the robot at {self._what} is in use: {owner}; end that first (lock file "
                f"{self.path})",
                owner,
            ) from None
        try:
            return os.path.samestat(os.fstat(file.fileno()), os.stat(self.path))
        except FileNotFoundError:
            return False


def _owner(file: TextIOWrapper) -> str:
    """Return the owner that the file names, for the user."""
    try:
        file.seek(0)
        owner = json.loads(file.read(4096))
        return f"process {owner['pid']} ({owner['command']}) since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "by a process that left no name"
