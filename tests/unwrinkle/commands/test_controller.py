"""`unwrinkle controller`, and the virtual equipment that it runs."""

import dataclasses as dc
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    FeedbackBody,
    Framer,
    MessageType,
    MotionControl,
    MotionReply,
    WriteIo,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site, loopback_site
from unwrinkle.simulation.controllers.server import KINDS, ServerFault
from unwrinkle.site.virtual_equipment import VirtualEquipment

pytestmark = pytest.mark.alone


@pytest.fixture
def equipment(cell: Cell) -> Iterator[Callable[..., VirtualEquipment]]:
    made: list[VirtualEquipment] = []

    def make(site: Site | None = None, **options: object) -> VirtualEquipment:
        site = loopback_site() if site is None else site
        start = cell.robot.named_states["home"]
        made.append(VirtualEquipment(site, cell.limits, start, ports=(0, 0, 0), **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_the_axes_lag_behind_what_is_commanded(equipment: Callable[..., VirtualEquipment]) -> None:
    virtual = equipment(lag=0.05)
    virtual.step(10.0)
    group = virtual.controller
    home = group.positions
    assert np.array_equal(virtual.measured, home)
    virtual.measured = home + 0.1  # as if the controller had just jumped back
    virtual.step(10.05)
    np.testing.assert_allclose(virtual.measured - home, 0.1 / np.e)
    for k in range(100):
        virtual.step(10.1 + 0.01 * k)
    np.testing.assert_allclose(virtual.measured, home, atol=1e-6)


def test_a_late_step_sends_the_feedback_that_it_missed(
    equipment: Callable[..., VirtualEquipment],
) -> None:
    """A busy computer delays feedback; it makes none that jumps."""
    virtual = equipment(lag=0.2)
    virtual.step(10.0)
    with closing(
        TcpLink(socket.create_connection(("127.0.0.1", virtual.server.ports[1])), "state")
    ) as link:
        virtual.step(10.01)
        virtual.measured = virtual.controller.positions + 0.1
        virtual.step(10.21)
        assert link.wait(1.0)
        messages = Framer().feed(link.receive(1 << 16))
    sets = [FeedbackBody.of(each) for each in messages if each.type == MessageType.JOINT_FEEDBACK]
    steps = -np.diff([body.positions[0] for body in sets if body.group == 0])
    assert len(steps) == 7
    assert 0.0 < steps.max() <= 1.01 * 0.1 * (1.0 - np.exp(-0.025 / 0.2))


def test_outputs_close_the_grippers_and_inputs_tell(
    equipment: Callable[..., VirtualEquipment],
) -> None:
    virtual = equipment(cloth=False)
    virtual.step(0.0)
    virtual.controller.handle_io(WriteIo(10010, 0).to_message())
    told = []
    for k in range(30):
        told += virtual.step(0.02 * k)
    assert told[-1] == "grippers (right, left): closed, open"
    assert [virtual.controller.inputs[a] for a in (25010, 25011, 25012, 25013)] == [1, 0, 0, 0]


def test_it_tells_of_connections_faults_and_modes(
    equipment: Callable[..., VirtualEquipment],
) -> None:
    virtual = equipment(faults=(ServerFault("e_stop", at=1.0),), lag=0.0)
    link = TcpLink.connect("127.0.0.1", virtual.server.ports[0], 2.0, "controller")
    with closing(link):
        told = virtual.step(0.0)
        link.send(MotionControl(-1, 1, Command.START_TRAJ_MODE).to_message().encode())
        virtual.server.motion[0].wait(2.0)
        for k in range(1, 300):
            told += virtual.step(0.004 * k)
        (reply,) = Framer().feed(link.receive())
    assert MotionReply.of(reply).result == 0
    assert re.fullmatch(r"motion client 127\.0\.0\.1:\d+ connected", told[0])
    assert told[1:] == [
        "servos: on",
        "trajectory mode: on",
        f"fault e_stop begins: {KINDS['e_stop']}",
        "emergency stop: pressed",
        "servos: off",
        "trajectory mode: off",
    ]


def test_profile_and_synchrony_are_the_sites(equipment: Callable[..., VirtualEquipment]) -> None:
    site = loopback_site()
    changed = dc.replace(site.controller, profile="ex", synchro="each")
    settings = equipment(dc.replace(site, controller=changed)).controller.settings
    assert (settings.accepts, settings.synchro) == ("ex", True)


def test_pan_tilt_units_have_devices(equipment: Callable[..., VirtualEquipment]) -> None:
    virtual = equipment(pan_tilt=True)
    assert len(virtual.devices) == 2 and all(Path(device).exists() for device in virtual.devices)
    line = os.open(virtual.devices[1], os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(line, b"PR ")
        for k in range(50):
            virtual.step(0.02 * k)
        assert b"46.2857" in os.read(line, 200)  # the shipped head's
    finally:
        os.close(line)


def test_the_command_runs_for_a_while(
    main: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    code = main("controller", "--ports", "0,0,0", "--seconds", "0.1", "--fault", "hold@0.05")
    out = capsys.readouterr().out
    assert code == 0
    assert re.search(r"virtual controller on 127\.0\.0\.1: motion \d+, state \d+, I/O \d+", out)
    assert "fault hold begins" in out and "hold: pressed" in out


def test_the_command_lists_its_faults(
    main: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main("controller", "--list-faults") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(KINDS)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--ports", "1,2"), "give three port numbers"),
        (("--fault", "fire@3"), "fault 'fire' is unknown"),
        (("--profile", "both2"), "groups, ex or both"),
        (("--site", "nowhere"), "no site 'nowhere'"),
    ],
)
def test_bad_options_are_refused(
    main: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    words: str,
) -> None:
    assert main("controller", *options) == 2
    assert words in capsys.readouterr().err


def test_a_taken_port_is_named(
    main: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    equipment: Callable[..., VirtualEquipment],
) -> None:
    taken = equipment().server.ports[1]
    assert main("controller", "--ports", f"0,{taken},0") == 4
    assert f"127.0.0.1:{taken} (state)" in capsys.readouterr().err


@pytest.mark.end_to_end
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_told_to_end(number: int) -> None:
    arguments = [sys.executable, "-u", "-m", "unwrinkle", "controller", "--ports", "0,0,0"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"state (\d+)", process.stdout.readline())
            assert found is not None
            link = TcpLink.connect("127.0.0.1", int(found[1]), 5.0, "state")
            with closing(link):
                framer, types = Framer(), []
                while len(types) < 15 and link.wait(5.0):
                    types += [message.type for message in framer.feed(link.receive())]
            assert types[:10] == [15, 15, 15, 13] * 2 + [15, 15]
        finally:
            process.send_signal(number)
        assert process.wait(20.0) == 0
