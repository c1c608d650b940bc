"""`unwrinkle site check` against virtual devices, intact and faulty; nothing may move."""

import dataclasses as dc
import io
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from unwrinkle import cli
from unwrinkle.hardware.controller.clear_queue import clear_queue
from unwrinkle.hardware.controller.lock import OwnerLock
from unwrinkle.hardware.motoros.messages import Command, MessageType, MotionControl, TrajectoryPoint
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault
from unwrinkle.site.check import DeviceRow, check_site
from unwrinkle.site.sites import find_site

pytestmark = pytest.mark.alone


@dc.dataclass(frozen=True)
class Running:
    """A virtual controller that runs in a thread, and its site."""

    controller: VirtualController
    site: Site


@pytest.fixture
def start(cell: Cell) -> Iterator[Callable[..., Running]]:
    """Start virtual controllers; they end with the test."""
    ends: list[Callable[[], None]] = []

    def begin(*faults: ServerFault, at: np.ndarray | None = None) -> Running:
        limits = (cell.limits.lower, cell.limits.upper, cell.limits.velocity)
        where = np.zeros(13) if at is None else at
        controller = VirtualController(VirtualControllerSettings(), where, limits)
        server = ControllerServer(controller, faults=faults)
        ended = threading.Event()

        def loop() -> None:
            while not ended.is_set():
                server.wait(0.002)
                server.poll(time.monotonic())

        thread = threading.Thread(target=loop)
        thread.start()
        ends.extend((ended.set, thread.join, server.close))
        names = ("motion_port", "state_port", "io_port")
        ports = dict(zip(names, server.ports, strict=True))
        site = find_site("loopback")
        return Running(
            controller, dc.replace(site, controller=dc.replace(site.controller, **ports))
        )

    yield begin
    for end in ends:
        end()


def rows_of(site: Site, cell: Cell) -> dict[str, DeviceRow]:
    return {row.name: row for row in check_site(site, cell.limits)}


def bad(rows: dict[str, DeviceRow]) -> list[str]:
    return [row.name for row in rows.values() if not row.passed]


def test_a_whole_site(start: Callable[..., Running], cell: Cell) -> None:
    running = start()
    rows = rows_of(running.site, cell)
    assert bad(rows) == []
    assert "sets per second of the groups r1, r2, ext_axis" in rows["joint feedback"].text
    assert "25010 is 0" in rows["grippers"].text
    kinds = {message.type for _, message in running.controller.messages}
    assert kinds <= {MessageType.READ_IO_BIT}, "nothing but questions may be sent"


def test_nobody_is_there(cell: Cell) -> None:
    site = find_site("loopback")
    # Nothing listens on port 1 of this machine.
    ports = {"motion_port": 1, "state_port": 1, "io_port": 1}
    site = dc.replace(site, controller=dc.replace(site.controller, **ports))
    rows = rows_of(site, cell)
    assert bad(rows) == ["controller state", "controller motion", "controller I/O", "grippers"]
    assert "127.0.0.1:1 was not tried" in rows["controller motion"].text


def left_in_motion(running: Running) -> np.ndarray:
    """Leave increments in the queues of a disconnected controller; return the axes' positions."""
    controller, c = running.controller, running.site.controller
    link = TcpLink.connect(c.host, c.motion_port, 2.0, "a client that dies")
    link.send(MotionControl(-1, 0, Command.START_TRAJ_MODE).to_message().encode())
    end = time.monotonic() + 5.0
    while not controller.pendant.trajectory_mode and time.monotonic() < end:
        time.sleep(0.01)
    for sequence in range(3):  # half a second at constant speed
        for group, size in enumerate((6, 6, 1)):
            t = 0.25 * sequence
            point = TrajectoryPoint(group, sequence, t + 4e-4, (0.4 * t,) * size, (0.4,) * size)
            link.send(point.to_message().encode())
            time.sleep(0.012)
    link.close()
    time.sleep(0.4)
    assert min(controller.queued) > 0
    return controller.positions


def test_what_a_dead_client_left_in_the_queues_is_told_and_never_run(
    start: Callable[..., Running], cell: Cell
) -> None:
    running = start()
    stood = left_in_motion(running)
    rows = rows_of(running.site, cell)
    assert bad(rows) == ["controller motion"]
    assert "HOLD on the pendant" in rows["controller motion"].text
    assert "--clear-queue" in rows["controller motion"].text
    assert np.array_equal(running.controller.positions, stood)
    assert not [m for _, m in running.controller.messages if m.type == MessageType.PING]


def test_the_queues_are_emptied_once_that_is_confirmed(
    start: Callable[..., Running],
    cell: Cell,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    running = start()
    stood = left_in_motion(running)
    path = tmp_path / "lab.site.yaml"
    path.write_text(yaml.safe_dump(dc.asdict(running.site)))
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "site", "check", str(path), "--clear-queue"])

    def check(typed: str) -> int:
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return int(stop.value.code or 0)

    for typed in ("", "yes\n"):
        assert check(typed) == 2
        assert "the queues were not emptied" in capsys.readouterr().err
    assert min(running.controller.queued) > 0
    assert check("clear\n") == 0
    assert "the controller's queues are empty" in capsys.readouterr().out
    assert max(running.controller.queued) == 0
    # The controller runs a few periods before it reads the first bytes, not what was left: 0.2 rad.
    assert np.abs(running.controller.positions - stood).max() < 0.02
    assert clear_queue(running.site.controller).needed is False


def test_what_the_robot_says(start: Callable[..., Running], cell: Cell) -> None:
    running = start()
    running.controller.pendant.press_e_stop()
    rows = rows_of(running.site, cell)
    assert bad(rows) == ["robot status"]
    assert "emergency stop" in rows["robot status"].text


@pytest.mark.parametrize(
    ("fault", "name", "text"),
    [
        ("groups", "joint feedback", "expected [0, 1, 2]"),
        ("degrees", "joint positions", "are the values degrees"),
        ("nan", "joint positions", "not a finite number"),
        ("silent_state", "joint feedback", "no joint feedback"),
        ("garbage", "controller state", ""),
    ],
)
def test_feedback_that_is_wrong(
    start: Callable[..., Running], cell: Cell, fault: str, name: str, text: str
) -> None:
    # An axis is so far from zero that degrees cannot be radians.
    running = start(ServerFault(fault), at=np.full(13, 0.2))
    rows = rows_of(running.site, cell)
    assert name in bad(rows)
    assert text in rows[name].text


def test_a_robot_in_use_is_left_alone(start: Callable[..., Running], cell: Cell) -> None:
    running = start()
    c = running.site.controller
    lock = OwnerLock(c.host, c.motion_port, "another program")
    lock.acquire()
    try:
        rows = rows_of(running.site, cell)
    finally:
        lock.release()
    assert bad(rows) == ["controller motion", "controller I/O", "grippers"]
    assert "another program" in rows["controller motion"].text


def test_what_is_not_installed_or_missing(
    start: Callable[..., Running], cell: Cell, tmp_path: Path
) -> None:
    site = start().site
    site = dc.replace(
        site,
        virtual=False,
        pan_tilt=dc.replace(site.pan_tilt, left=str(tmp_path / "ttyNone"), reply_timeout=0.01),
        cameras=dc.replace(site.cameras, kind="watch", folder=str(tmp_path / "none")),
        grippers=dc.replace(site.grippers, closed_input=[25010, 99]),
    )
    rows = rows_of(site, cell)
    assert bad(rows) == ["left pan-tilt unit", "cameras", "grippers", "calibration"]
    assert "ttyNone" in rows["left pan-tilt unit"].text
    assert "there is no folder" in rows["cameras"].text
    assert "the addresses 99" in rows["grippers"].text


def test_the_command(
    start: Callable[..., Running],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    running = start()
    path = tmp_path / "lab.site.yaml"
    path.write_text(yaml.safe_dump(dc.asdict(running.site)))

    def check(name: str) -> int:
        monkeypatch.setattr(sys, "argv", ["unwrinkle", "site", "check", name])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return int(stop.value.code or 0)

    assert check(str(path)) == 0
    assert "every device answers" in capsys.readouterr().out
    running.controller.pendant.press_e_stop()
    assert check(str(path)) == 4
    captured = capsys.readouterr()
    assert "an emergency stop is pressed" in captured.out
    assert captured.err == "unwrinkle: site loopback: 1 of 12 checks failed: robot status\n"
    assert check("nowhere") == 2
