"""The loop that polls the driver: requests of a proxy, failures of a poll, and the end, on a clock
that the test moves.
"""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.controller.base import DigitalIo, Driver
from unwrinkle.hardware.controller.driver_loop import LONGEST_SILENCE_S, DriverLoop
from unwrinkle.hardware.controller.proxy import CLOSE, COMMANDS, DriverProxy, DriverReport
from unwrinkle.hardware.controller_state import DriverStatus
from unwrinkle.hardware.message_pipe import MessagePipe
from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.models.errors import InUseError
from unwrinkle.planning.trajectory import Trajectory

RigMaker = Callable[..., Any]
TrajectoryMaker = Callable[..., Trajectory]

OFFLINE = "offline"


class Program:
    """The program's end of the pipe. Between two turns of the rig the next step of a script runs.

    Each step yields a condition on the driver's status, and goes on once it holds.
    """

    def __init__(self, rig: Any, script: Callable[["Program"], Iterator[Callable[[], bool]]]):
        self.rig = rig
        ours, theirs = socket.socketpair()
        self.pipe, self._other = MessagePipe(ours), MessagePipe(theirs)
        self._steps = script(self)
        self._condition: Callable[[], bool] = lambda: True
        rig.driver.close = self._close
        self.loop = DriverLoop(rig.driver, self._other, self._turn)

    @property
    def status(self) -> DriverStatus:
        status: DriverStatus = self.rig.driver.status
        return status

    def ask(self, name: str = "", *arguments: object) -> None:
        with suppress(TimeoutError):
            while True:  # nobody else reads the reports
                self.pipe.receive()
        self.pipe.send((name, arguments, {}))

    def run(self, most: float = 60.0) -> None:
        end = self.rig.time + most
        self.loop.run(lambda: bool(self.rig.time > end))
        self.pipe.close()
        self._other.close()

    def _close(self) -> None:
        """Disconnect while the server answers, since leaving waits for its replies."""
        over = threading.Event()

        def serve() -> None:
            while not over.is_set():
                self.rig.server.wait(0.005)
                self.rig.server.answer()

        thread = threading.Thread(target=serve)
        thread.start()
        type(self.rig.driver).close(self.rig.driver)
        over.set()
        thread.join()
        self.rig.server.answer()

    def _turn(self) -> float:
        self.rig.turn_server()
        if self._condition():
            self._condition = next(self._steps, lambda: False)
        return float(self.rig.time)


def test_it_runs_a_trajectory_and_disconnects(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig, trajectory = make_rig(), make_trajectory(1)

    def after(duration: float) -> Callable[[], bool]:
        end = rig.time + duration
        return lambda: bool(rig.time > end)

    def script(program: Program) -> Iterator[Callable[[], bool]]:
        yield lambda: program.status.state == "ready"
        program.ask("run", 1, trajectory, "a motion")
        while program.status.completed < 1:
            program.ask()  # a program that waits asks for reports
            yield after(0.5)
        program.ask(CLOSE)
        yield lambda: False

    Program(rig, script).run()
    assert rig.state == OFFLINE
    np.testing.assert_allclose(rig.controller.positions, trajectory.positions[-1], atol=1e-3)
    assert rig.sent_commands()[-2:] == [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
    assert rig.controller.underruns == 0


@pytest.mark.parametrize("dies", [False, True])
def test_the_end_of_the_program_in_motion_holds_along_the_path(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, dies: bool
) -> None:
    rig, trajectory = make_rig(), make_trajectory(2)

    def script(program: Program) -> Iterator[Callable[[], bool]]:
        yield lambda: program.status.state == "ready"
        program.ask("run", 1, trajectory)
        yield lambda: program.status.progress > 0.3
        if dies:
            program.pipe.close()
        else:
            program.ask(CLOSE)
        yield lambda: False

    Program(rig, script).run()
    assert rig.state == OFFLINE
    assert rig.sent_commands()[-2:] == [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
    assert Command.STOP_MOTION not in rig.sent_commands() and rig.controller.underruns == 0
    curve = trajectory.interpolant()(np.linspace(0.0, trajectory.duration, 20_000))
    assert np.abs(curve - rig.controller.positions).max(axis=1).min() < 1e-3


def test_a_silent_program_has_its_robot_held(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig, trajectory = make_rig(), make_trajectory(2)
    held: list[float] = []

    def script(program: Program) -> Iterator[Callable[[], bool]]:
        yield lambda: program.status.state == "ready"
        program.ask("set_override", 0.25)
        program.ask("run", 1, trajectory)
        began = rig.time
        yield lambda: program.status.state == "holding"
        held.append(rig.time - began)
        yield lambda: program.status.state == "held"
        program.ask(CLOSE)
        yield lambda: False

    Program(rig, script).run()
    assert held[0] == pytest.approx(LONGEST_SILENCE_S, abs=0.05)
    assert rig.controller.underruns == 0


def test_an_exception_in_a_poll_stops_the_robot(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()
    step, broken = rig.driver._step, [False]

    def fails(now: float) -> None:
        if broken.pop():
            broken.append(False)
            raise ZeroDivisionError("a bug")
        broken.append(False)
        step(now)

    monkeypatch.setattr(rig.driver, "_step", fails)
    seen: list[DriverStatus] = []

    def script(program: Program) -> Iterator[Callable[[], bool]]:
        yield lambda: program.status.state == "ready"
        program.ask("run", 1, make_trajectory(3))
        yield lambda: program.status.progress > 0.3
        broken[:] = [True]
        yield lambda: Command.STOP_MOTION in rig.sent_commands()
        seen.append(program.status)
        program.ask(CLOSE)
        yield lambda: False

    Program(rig, script).run()
    assert seen[0].state == "fault" and "ZeroDivisionError: a bug" in seen[0].reason


def test_a_second_exception_closes_the_connections(
    make_rig: RigMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()

    def fails(now: float) -> None:
        raise ZeroDivisionError("a bug")

    closed: list[bool] = []

    def script(program: Program) -> Iterator[Callable[[], bool]]:
        yield lambda: program.status.state == "ready"
        monkeypatch.setattr(rig.driver, "_step", fails)
        yield lambda: "failed again" in program.status.reason
        closed.append(all(link.closed for link in rig.driver.links.values()))
        program.ask()
        yield lambda: True
        program.ask(CLOSE)
        yield lambda: False

    program = Program(rig, script)
    program.run()
    assert closed == [True] and rig.state == OFFLINE


def test_a_refused_connection_is_the_first_answer(make_rig: RigMaker) -> None:
    first = make_rig()
    first.connect()
    second = make_rig(motion_port=first.site.motion_port, state_port=first.site.state_port)
    ours, theirs = socket.socketpair()
    pipe = MessagePipe(ours)
    DriverLoop(second.driver, MessagePipe(theirs)).run()
    answer = pipe.receive(1.0)
    assert isinstance(answer, InUseError) and "(test)" in str(answer)
    assert second.state == OFFLINE
    theirs.close()
    ours.close()


def test_the_proxy_passes_on_what_the_protocol_names() -> None:
    """Every command and every property, by the protocol's own names."""
    names = {name for part in (DigitalIo, Driver) for name in vars(part) if name[0] != "_"}
    properties = names - COMMANDS
    assert {"run", "hold", "set_override", "read_input"} <= COMMANDS
    assert properties == {field for field in vars(DriverReport()) if field[0] != "_"}
    assert names <= set(vars(DriverProxy))
    ours, theirs = socket.socketpair()
    proxy, other = DriverProxy(MessagePipe(ours)), MessagePipe(theirs)
    for name in sorted(COMMANDS):
        other.send(DriverReport(inputs={1: 1}))
        arguments = {"run": (1, None), "write_output": (3, 1)}.get(name, (2,))
        getattr(proxy, name)(*arguments[: 0 if name == "reset" else None])
        request = other.receive(1.0)
        assert request[0] == name and request[1] == (() if name == "reset" else arguments)
    theirs.close()
    assert proxy.status.state == "fault"  # nobody answers
    assert proxy.inputs == {} and proxy.status.reason != ""


def test_a_message_in_parts_blocks_nobody() -> None:
    ours, theirs = socket.socketpair()
    sender, receiver = MessagePipe(ours), MessagePipe(theirs)
    sender.send(list(range(1000)))
    whole = theirs.recv(1 << 16)
    ours.sendall(whole[:5])
    with pytest.raises(TimeoutError):
        receiver.receive()
    ours.sendall(whole[5:-1])
    with pytest.raises(TimeoutError):
        receiver.receive(0.01)
    ours.sendall(whole[-1:])
    assert receiver.receive(1.0) == list(range(1000))
    sender.close()
    with pytest.raises(EOFError):
        receiver.receive(1.0)
    receiver.close()
