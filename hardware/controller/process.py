"""The controller's driver in a process of its own, so that it is polled on time whatever the
program computes.

A Python program that renders, matches images or collects garbage stops all of its threads for
tenths of a second, which is longer than the robot's queue lasts. If the parent process dies for any
reason, the child stops the robot along its path and disconnects.
"""

import contextlib
import gc
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from unwrinkle.hardware.controller.driver import QUEUE_KEPT, ControllerDriver
from unwrinkle.hardware.controller.proxy import (
    COMMANDS,
    LONGEST_CLOSE_S,
    DriverProxy,
    DriverReport,
)
from unwrinkle.hardware.controller.thread import DriverThread
from unwrinkle.hardware.controller_state import FAULT, OFFLINE, DriverStatus
from unwrinkle.hardware.run_log.protocol import RunLogger
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import ConnectionLostError, HardwareError, OverdueError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

#: Longest start of the process, beside the site's own deadlines, s.
_LONGEST_START_S = 30.0
#: Longest wait for a report of the process, s.
_LONGEST_ANSWER_S = 3.0
#: A program that calls nothing for this long while its robot moves is taken to hang, and the robot
#: is held, s.
LONGEST_SILENCE_S = 2.0
#: Between two reports while waiting, s.
_WAIT_PERIOD_S = 0.01
#: Message of a process that has ended.
_ENDED = "the driver's process has ended"


class DriverProcess(DriverProxy):
    """Has a driver polled by another process until it is closed.

    While the robot moves, a method has to be called at least every `LONGEST_SILENCE_S` seconds
    (`wait` does so): otherwise the program is taken to hang, and the robot is held.
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
        owner = f"{command or 'a program'}, process {os.getpid()}"
        self._arguments = (site, limits, log, owner, io, full_speed)
        self._deadline = _LONGEST_START_S + 3.0 * site.connect_timeout
        self._lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection[Any, Any] | None = None
        self._last = DriverReport()

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
            self._connection = Connection(ours.detach())
            with contextlib.suppress(OSError):  # reported by the missing answer
                self._connection.send_bytes(pickle.dumps(self._arguments))
            problem = self._answer(self._deadline)
            if problem is not None:
                self._end()
                raise problem

    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second call changes
        nothing.
        """
        with self._lock:
            if self._process is None:
                return
            if self._connection is not None:
                with contextlib.suppress(OSError):
                    self._connection.send(("close", ()))
                self._answer(2.0 * LONGEST_CLOSE_S)
            self._end()
            self._last = DriverReport(DriverStatus(state=OFFLINE), self._last.feedback)

    @property
    def pid(self) -> int | None:
        """Identifier of the other process; None before `start`."""
        return None if self._process is None else self._process.pid

    def report(self) -> DriverReport:
        """Return what the driver reports now; a process that has ended is a fault.

        The feedback is the same object until a newer set has come.
        """
        return self._ask()

    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait at most `timeout`, s of real time, until the status fulfils `predicate`; return
        whether it does.
        """
        end = time.monotonic() + timeout
        while not predicate(self.status):
            if time.monotonic() > end:
                return False
            time.sleep(_WAIT_PERIOD_S)
        return True

    def _call(self, command: str, *arguments: object) -> None:
        self._ask(command, *arguments)

    def _ask(self, name: str = "", *arguments: Any) -> DriverReport:
        """Have a command called, if one is named, and return the report that follows."""
        with self._lock:
            if self._connection is None:
                return self._last
            try:
                self._connection.send((name, arguments))
            except OSError:
                problem: HardwareError | None = ConnectionLostError(_ENDED)
            else:
                problem = self._answer(_LONGEST_ANSWER_S)
            if problem is not None:
                self._end()
                # A process that ended by itself has braked and disconnected; one that was killed
                # has not.
                left = self._process is not None and (self._process.returncode or 0) >= 0
                after = "it braked, and left the controller" if left else QUEUE_KEPT
                status = DriverStatus(
                    state=FAULT,
                    command=self._last.status.command,
                    completed=self._last.status.completed,
                    reason=f"{problem}; {after}",
                )
                self._last = DriverReport(status, self._last.feedback)
            return self._last

    def _answer(self, deadline: float) -> HardwareError | None:
        """Receive a report within `deadline`, s; return why there is none."""
        connection = self._connection
        assert connection is not None
        try:
            if not connection.poll(deadline):
                text = f"the driver's process did not answer within {deadline:g} s"
                return OverdueError(text, deadline, deadline)
            answer = connection.recv()
        except (OSError, EOFError):
            return ConnectionLostError(_ENDED)
        if isinstance(answer, HardwareError):
            return answer
        before, now = self._last.feedback, answer.feedback
        if before is not None and now is not None and before.count == now.count:
            answer = DriverReport(
                answer.status, before, answer.inputs, answer.outputs_written, answer.io_problem
            )
        self._last = answer
        return None

    def _end(self) -> None:
        """Close the connection to the other process, which then holds and disconnects by itself."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            try:
                self._process.wait(2.0 * LONGEST_CLOSE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def serve(connection: "Connection[Any, Any]") -> None:
    """Drive in the other process until a close request, the parent's end, or SIGTERM."""
    site, limits, path, command, io, full_speed = pickle.loads(connection.recv_bytes())
    log = RunLog.join(path) if path is not None else None
    try:
        logger: RunLogger | None = log
        driver = ControllerDriver(
            site, limits, log=logger, command=command, io=io, full_speed=full_speed
        )
        with DriverThread(driver) as thread:
            gc.freeze()  # keeps collections short
            connection.send(thread.report())
            with contextlib.suppress(EOFError, OSError):
                _obey(connection, thread)
        with contextlib.suppress(OSError):
            connection.send(DriverReport())
    except HardwareError as error:
        with contextlib.suppress(OSError):
            connection.send(error)
    finally:
        if log is not None:
            log.close()


def _obey(connection: "Connection[Any, Any]", thread: DriverThread) -> None:
    while True:
        while not connection.poll(LONGEST_SILENCE_S):
            thread.pause(f"the program has said nothing for {LONGEST_SILENCE_S:g} s; does it hang?")
        name, arguments = connection.recv()
        if name == "close":
            return
        if name in COMMANDS:
            try:
                getattr(thread, name)(*arguments)
            except HardwareError as error:
                thread.fail(str(error))
        connection.send(thread.report())


def _leave(number: int, frame: object) -> None:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    # Ctrl-C in a terminal goes to both processes; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    with contextlib.suppress(OSError):
        os.nice(-5)
    # Imported under its own name, so that pickled classes are found on the other side.
    from unwrinkle.hardware.controller import process

    process.serve(Connection(int(sys.argv[1])))
