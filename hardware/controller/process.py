"""The controller's driver in a process of its own, so that it is polled on time whatever the
program computes.

A Python program that renders, matches images or collects garbage stops all of its threads for
tenths of a second, which is longer than the robot's queue lasts. If the parent process dies for any
reason, the child stops the robot along its path and disconnects.
"""

import contextlib
import gc
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.driver_loop import DriverLoop
from unwrinkle.hardware.controller.proxy import LONGEST_CLOSE_ANSWER_S, DriverProxy
from unwrinkle.hardware.message_pipe import MessagePipe
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

#: Longest start of the process, beside the site's own deadlines, s.
_LONGEST_START_S = 30.0


class DriverProcess(DriverProxy):
    """Has a driver polled by another process until it is closed.

    As a context manager it connects at the start; at the end, also after an exception, it holds,
    waits for rest and disconnects.
    """

    def __init__(
        self,
        site: ControllerSite,
        limits: Limits,
        *,
        log: Path | None = None,
        command: str = "",
        io: bool = True,
        full_speed: Array | None = None,
    ) -> None:
        """Prepare; nothing is started or connected before `start`.

        Args:
            site: of the controller.
            limits: of the thirteen axes.
            log: file of a run log that has been created; both processes append to it.
            command: name of the lock's owner.
            io: whether the controller's inputs and outputs are needed.
            full_speed: (13,) rad/s, of which the site's speed cap is a share; the limits' velocity
                if None.
        """
        super().__init__()
        owner = f"{command or 'a program'}, process {os.getpid()}"
        self._arguments = (site, limits, log, owner, io, full_speed)
        self._deadline = _LONGEST_START_S + 3.0 * site.connect_timeout
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the process and connect; a second call changes nothing.

        Raises:
            HardwareError: the robot is in use, a server does not answer, or the process does not
                start.
        """
        with self._lock:
            if self._process is not None:
                return
            ours, theirs = socket.socketpair()
            with theirs:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", __name__, str(theirs.fileno())],
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                )
            self._pipe = MessagePipe(ours)
            problem = self._request(self._arguments, self._deadline)
            if problem is not None:
                self._end()
                raise problem

    @property
    def pid(self) -> int | None:
        """Identifier of the other process; None before `start`."""
        return None if self._process is None else self._process.pid

    def __enter__(self) -> Self:
        """Connect."""
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hold, wait for rest, disconnect."""
        self.close()

    def _end(self) -> None:
        """Close the pipe, and wait until the other process has held and disconnected."""
        super()._end()
        if self._process is not None:
            try:
                self._process.wait(LONGEST_CLOSE_ANSWER_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _left_behind(self) -> str:
        # A process that ended by itself has braked and disconnected; one that was killed has not.
        if self._process is not None and (self._process.returncode or 0) >= 0:
            return "it braked, and left the controller"
        return super()._left_behind()


def serve(pipe: MessagePipe) -> None:
    """Drive in the other process until a close request, the parent's end, or SIGTERM."""
    signals: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: signals.append(number))
    site, limits, path, command, io, full_speed = pipe.receive(_LONGEST_START_S)
    log = None if path is None else RunLog.join(path)
    with contextlib.nullcontext() if log is None else contextlib.closing(log):
        driver = ControllerDriver(
            site, limits, log=log, command=command, io=io, full_speed=full_speed
        )
        gc.freeze()  # keeps collections short
        DriverLoop(driver, pipe).run(lambda: bool(signals))


if __name__ == "__main__":
    # Ctrl-C in a terminal goes to both processes; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.nice(-5)
    # Imported under its own name, so that pickled classes are found on the other side.
    from unwrinkle.hardware.controller import process

    process.serve(MessagePipe(socket.socket(fileno=int(sys.argv[1]))))
