"""The controller's driver in a process of its own: whatever else the program computes, it streams and watches on time.

A Python program that renders, matches images or collects garbage stops all of its threads for tenths of a second. The
robot's queue does not wait so long. The other process ends with a hold and a clean disconnect when this one dies, however
it dies: nobody is left to want the motion.
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
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.controller.driver import QUEUE_KEPT, ControllerDriver
from unwrinkle.hardware.controller.thread import LEAVING, DriverThread
from unwrinkle.hardware.controller_state import FAULT, OFFLINE, DriverStatus, JointFeedback
from unwrinkle.hardware.run_log.protocol import RunLogger
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import Trajectory

#: s: until the process has started and connected, beside the site's own deadline; for an answer of it.
_START, _ANSWER = 30.0, 3.0
#: A program that says nothing for so long while its robot moves is taken to hang, and the robot is held, s.
SILENCE = 2.0
#: Between two looks at the status while waiting, s.
_LOOK = 0.01
#: What a request may call.
_COMMANDS = (
    "run",
    "hold",
    "resume",
    "stop",
    "reset",
    "fail",
    "set_override",
    "write_output",
    "read_input",
)


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """What the other process's driver says."""

    status: DriverStatus = field(default_factory=DriverStatus)
    feedback: JointFeedback | None = None
    inputs: dict[int, int | None] = field(default_factory=dict)
    outputs_written: dict[int, int | None] = field(default_factory=dict)
    io_problem: str = ""


class DriverProcess:
    """Has a driver polled by another process until it is closed; every method may be called from any thread.

    It offers what `DriverThread` offers. While the robot moves, something of it has to be called at least every `SILENCE`
    seconds (`wait` does): a program that says nothing is taken to hang, and the robot is held. As a context manager it connects at the start; at the end, however that comes, it
    holds, waits for rest and disconnects.
    """

    def __init__(
        self,
        site: ControllerSite,
        limits: Limits,
        *,
        log: Path | None = None,
        command: str = "",
        io: bool = True,
        full_speed: "NDArray[np.float64] | None" = None,
    ) -> None:
        """Prepare; nothing is connected before `start`.

        Args:
            site: of the controller.
            limits: of the thirteen axes.
            log: file of a run log that was begun; both processes append to it.
            command: what the lock's owner is called.
            io: whether the controller's inputs and outputs are needed.
            full_speed: (13,) of the axes, rad/s, that the site's speed cap is a share of; the limits' if left out.
        """
        owner = f"{command or 'a program'}, process {os.getpid()}"
        self._arguments = (site, limits, log, owner, io, full_speed)
        self._deadline = _START + 3.0 * site.connect_timeout
        self._lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection[Any, Any] | None = None
        self._last = _Snapshot()

    def start(self) -> None:
        """Start the process and connect; a second time changes nothing.

        Raises:
            HardwareError: the robot is in use, nobody answers, or the process does not start.
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
            with contextlib.suppress(OSError):  # the answer says more
                self._connection.send_bytes(pickle.dumps(self._arguments))
            problem = self._answer(self._deadline)
            if problem:
                self._end()
                raise HardwareError(problem)

    def close(self) -> None:
        """Hold, wait for rest (bounded), leave trajectory mode, disconnect; a second time changes nothing."""
        with self._lock:
            if self._process is None:
                return
            if self._connection is not None:
                with contextlib.suppress(OSError):
                    self._connection.send(("close", ()))
                self._answer(2.0 * LEAVING)
            self._end()
            self._last = _Snapshot(DriverStatus(state=OFFLINE), self._last.feedback)

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

    # What it tells

    @property
    def pid(self) -> int | None:
        """Of the other process; None before `start`."""
        return None if self._process is None else self._process.pid

    @property
    def status(self) -> DriverStatus:
        """Newest status; a process that has ended is a fault."""
        return self._ask().status

    @property
    def feedback(self) -> JointFeedback | None:
        """Newest whole set; None before the first. The same object until another one comes."""
        return self._ask().feedback

    @property
    def inputs(self) -> dict[int, int | None]:
        """Digital inputs that were read, by address; None: the controller refused."""
        return self._ask().inputs

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Digital outputs that the controller has acknowledged, by address."""
        return self._ask().outputs_written

    @property
    def io_problem(self) -> str:
        """Why the I/O connection is of no use; empty if it is."""
        return self._ask().io_problem

    def wait(self, predicate: Callable[[DriverStatus], bool], timeout: float) -> bool:
        """Wait until the status fulfils something, at most so long (s, of real time); whether it does."""
        end = time.monotonic() + timeout
        while not predicate(self.status):
            if time.monotonic() > end:
                return False
            time.sleep(_LOOK)
        return True

    # Commands: see the driver

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        """Run a trajectory from where the robot rests."""
        self._ask("run", number, trajectory, name)

    def hold(self, number: int) -> None:
        """Brake along the path."""
        self._ask("hold", number)

    def resume(self, number: int) -> None:
        """Go on from a hold."""
        self._ask("resume", number)

    def stop(self, reason: str) -> None:
        """Hold, then leave trajectory mode."""
        self._ask("stop", reason)

    def reset(self) -> None:
        """Leave a latched fault."""
        self._ask("reset")

    def fail(self, text: str) -> None:
        """Stop at once, latch a fault."""
        self._ask("fail", text)

    def set_override(self, value: float) -> None:
        """Share of the planned speed, 0 to 1."""
        self._ask("set_override", value)

    def write_output(self, address: int, value: int) -> None:
        """Set a digital output."""
        self._ask("write_output", address, value)

    def read_input(self, address: int) -> None:
        """Ask for a digital input."""
        self._ask("read_input", address)

    # The other process

    def _ask(self, name: str = "", *arguments: Any) -> _Snapshot:
        """Have something called, and take what the driver says afterwards."""
        with self._lock:
            if self._connection is None:
                return self._last
            problem = ""
            try:
                self._connection.send((name, arguments))
            except OSError:
                problem = "the driver's process has ended"
            problem = problem or self._answer(_ANSWER)
            if problem:
                self._end()
                # One that was asked to end has braked and left; one that was killed has not.
                left = self._process is not None and (self._process.returncode or 0) >= 0
                after = "it braked, and left the controller" if left else QUEUE_KEPT
                status = DriverStatus(
                    state=FAULT,
                    command=self._last.status.command,
                    completed=self._last.status.completed,
                    reason=f"{problem}; {after}",
                )
                self._last = _Snapshot(status, self._last.feedback)
            return self._last

    def _answer(self, deadline: float) -> str:
        """Take a snapshot; else why there is none."""
        connection = self._connection
        assert connection is not None
        try:
            if not connection.poll(deadline):
                return f"the driver's process did not answer within {deadline:g} s"
            answer = connection.recv()
        except (OSError, EOFError):
            return "the driver's process has ended"
        if isinstance(answer, str):
            return answer
        before, now = self._last.feedback, answer.feedback
        if before is not None and now is not None and before.count == now.count:
            answer = _Snapshot(
                answer.status, before, answer.inputs, answer.outputs_written, answer.io_problem
            )
        self._last = answer
        return ""

    def _end(self) -> None:
        """Part from the other process, which holds and disconnects by itself."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            try:
                self._process.wait(2.0 * LEAVING)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def serve(connection: "Connection[Any, Any]") -> None:
    """What the other process does: drive until it is told to close, its parent is gone, or SIGTERM comes."""
    site, limits, path, command, io, full_speed = pickle.loads(connection.recv_bytes())
    log = RunLog.join(path) if path is not None else None
    try:
        logger: RunLogger | None = log
        driver = ControllerDriver(
            site, limits, log=logger, command=command, io=io, full_speed=full_speed
        )
        with DriverThread(driver) as thread:
            gc.freeze()  # what is there stays: the collector has little to look at
            connection.send(_snapshot(thread))
            with contextlib.suppress(EOFError, OSError):
                _obey(connection, thread)
        with contextlib.suppress(OSError):
            connection.send(_Snapshot())
    except HardwareError as error:
        with contextlib.suppress(OSError):
            connection.send(str(error))
    finally:
        if log is not None:
            log.close()


def _obey(connection: "Connection[Any, Any]", thread: DriverThread) -> None:
    while True:
        while not connection.poll(SILENCE):
            thread.pause(f"the program has said nothing for {SILENCE:g} s; does it hang?")
        name, arguments = connection.recv()
        if name == "close":
            return
        if name in _COMMANDS:
            try:
                getattr(thread, name)(*arguments)
            except HardwareError as error:
                thread.fail(str(error))
        connection.send(_snapshot(thread))


def _snapshot(thread: DriverThread) -> _Snapshot:
    return _Snapshot(
        thread.status,
        thread.feedback,
        dict(thread.inputs),
        dict(thread.outputs_written),
        thread.io_problem,
    )


def _leave(number: int, frame: object) -> None:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    # Ctrl-C in a terminal goes to both processes; the first one decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    with contextlib.suppress(OSError):
        os.nice(-5)
    # Under its own name, so that what is pickled is found at the other side.
    from unwrinkle.hardware.controller import process

    process.serve(Connection(int(sys.argv[1])))
