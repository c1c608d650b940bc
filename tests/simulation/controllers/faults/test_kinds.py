"""Every fault that the virtual controller's server commits does what its name says, and nothing
else.
"""

import os
import socket
from collections.abc import Callable
from math import inf, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Command,
    FeedbackBody,
    MotionControl,
    MotionReply,
    MultiFeedback,
    ReadIo,
    ReadIoReply,
    RobotStatusBody,
    WireError,
    WriteIo,
    WriteIoReply,
)
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.controllers.server import KINDS, ServerFault

pytestmark = pytest.mark.alone

READY = MotionControl(-1, 5, Command.CHECK_MOTION_READY).to_message()
Client = Any
Maker = Callable[..., Client]


def _stamps(client: Client, steps: int) -> list[float]:
    """Time stamps of the feedback of some periods, in the order of their coming."""
    stamps = []
    for _ in range(steps):
        client.poll(0.025)
        stamps += [FeedbackBody.of(m).time for m in client.read("state") if m.type == 15][::3]
    return stamps


def _status(client: Client) -> RobotStatusBody:
    client.poll(0.025)
    return RobotStatusBody.of(client.read("state")[-1])


def _refused(client: Client) -> tuple[int, int]:
    (reply,) = client.ask(MotionControl(-1, 2, Command.START_TRAJ_MODE).to_message())
    told = MotionReply.of(reply)
    return told.result, told.subcode


# ---------------------------------------------------------------- connections


@pytest.mark.parametrize(
    ("kind", "closed"),
    [
        ("close_motion", {"motion"}),
        ("close_state", {"state"}),
        ("close_all", {"motion", "state", "io"}),
    ],
)
def test_connections_are_closed_once(controller_client: Maker, kind: str, closed: set[str]) -> None:
    client = controller_client(ServerFault(kind, points=3))
    client.start()
    for sequence in range(3):
        client.move(sequence)
    client.poll(0.004)
    assert {name for name, links in client.server.links.items() if not links} == closed
    client.poll(
        0.06
    )  # until its tasks have ended, a motion connection with waiting increments is refused
    for name in closed:
        client.connect(name)
    client.poll(0.004)
    assert all(client.server.links.values())


@pytest.mark.parametrize(
    ("kind", "motion", "state"),
    [("silent", False, False), ("silent_motion", False, True), ("silent_state", True, False)],
)
def test_silence_keeps_the_connections(
    controller_client: Maker, kind: str, motion: bool, state: bool
) -> None:
    client = controller_client(ServerFault(kind, at=0.1, until=0.5))
    client.poll(0.1)
    client.read("state")
    assert bool(client.ask(READY)) == motion
    client.poll(0.025)
    assert bool(client.read("state")) == state
    assert all(client.server.links.values())
    client.poll(0.5)
    assert client.read("state") and client.ask(READY)


def test_single_bytes_carry_the_same_messages(controller_client: Maker) -> None:
    client = controller_client(ServerFault("split"))
    types = []
    for _ in range(200):
        client.poll(0.004)
        types += [message.type for message in client.read("state")]
    assert types[:10] == [15, 15, 15, 2017, 13] * 2 and len(types) >= 5 * 30
    replies = client.ask(READY)
    assert not replies  # the rest comes with the next poll
    client.poll(0.004)
    (reply,) = client.read("motion")
    assert MotionReply.of(reply).sequence == 5


@pytest.mark.parametrize("motion", [0.0, 1.0])
@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("garbage", {"length"}),
        ("wrong_length", {"length"}),
        ("huge_length", {"length"}),
        ("wrong_type", {"type"}),
    ],
)
def test_garbage_is_sent_where_it_is_asked_for(
    controller_client: Maker, kind: str, names: set[str], motion: float
) -> None:
    client = controller_client(ServerFault(kind, at=0.01, value=motion))
    client.read("state")
    client.poll(0.025)
    client.send("motion", READY)
    client.poll()
    corrupted, whole = ("motion", "state") if motion else ("state", "motion")
    assert client.read(whole)
    with pytest.raises(WireError) as caught:
        client.read(corrupted)
    assert caught.value.name in names


def test_a_slow_reader_waits_for_room_and_reads_all_then(controller_client: Maker) -> None:
    client = controller_client(ServerFault("slow", value=50.0))
    client.send("motion", READY)
    polls = 0
    while not (replies := client.read("motion")) and polls < 50:
        client.poll(0.004)
        polls += 1
    assert len(replies) == 1 and polls == pytest.approx(552 / 50.0, abs=2)
    assert not client.server.rejected  # it was whole


def test_what_comes_together_is_read_at_once(controller_client: Maker) -> None:
    client = controller_client(ServerFault("coalesce", value=0.02))
    for number in range(3):
        assert not client.ask(READY), number
        client.poll(0.004)
    assert not client.read("motion")
    client.poll(0.012)
    told = [MotionReply.of(reply) for reply in client.read("motion")]
    assert [t.command for t in told] == [Command.CHECK_MOTION_READY] * 3
    assert list(client.controller.audit.findings) == [
        "3 messages in one read; one request at a time"
    ]


def test_the_firmware_of_2013_obeys_nothing_of_two_messages_in_one_read(
    controller_client: Maker,
) -> None:
    client = controller_client(ServerFault("coalesce", value=0.02), firmware="2013")
    servos = MotionControl(-1, 5, Command.START_TRAJ_MODE).to_message()
    client.send("motion", servos)
    client.send("motion", servos)
    client.poll()
    client.poll(0.02)
    (reply,) = client.read("motion")
    told = MotionReply.of(reply)
    assert (told.result, told.subcode) == (3, 0) and not client.controller.starting
    assert client.server.motion
    client.send("motion", servos)
    client.poll()
    client.poll(0.02)
    assert client.controller.starting


@pytest.mark.parametrize("value", [0.0, 10.0, 40.0, 67.0])
def test_a_message_that_is_cut_is_lost(controller_client: Maker, value: float) -> None:
    client = controller_client(ServerFault("cut", value=value))
    client.send("motion", MotionControl(-1, 5, Command.START_SERVOS).to_message())
    client.poll()
    told = [MotionReply.of(reply) for reply in client.read("motion")]
    assert len(told) == 2  # one for each piece
    assert {(t.result, t.subcode) for t in told} <= {(3, 3001), (3, 3003)}
    assert told[0].subcode == 3001
    assert not client.controller.pendant.servo and client.server.motion


def test_buffers_are_small(controller_client: Maker) -> None:
    sizes = []
    for faults in ((), (ServerFault("tiny_buffers"),)):
        client = controller_client(*faults)
        with socket.socket(fileno=os.dup(client.server.motion[0].fileno())) as peer:
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                sizes.append(peer.getsockopt(socket.SOL_SOCKET, option))
    assert max(sizes[2:]) < 8192 < min(sizes[:2])


# ---------------------------------------------------------------- feedback


def test_sets_of_feedback_are_doubled_swapped_and_late(controller_client: Maker) -> None:
    usual = _stamps(controller_client(stamps=True), 6)
    assert usual[-1] == pytest.approx(0.148, abs=0.003) and usual == sorted(usual)
    doubled = _stamps(controller_client(ServerFault("duplicate"), stamps=True), 6)
    assert doubled[::2] == doubled[1::2] and len(doubled) == 14
    swapped = _stamps(controller_client(ServerFault("reorder"), stamps=True), 6)
    assert len(swapped) == 6 and swapped[1] < swapped[0] < swapped[3] < swapped[2]
    late = _stamps(controller_client(ServerFault("delay", value=0.05), stamps=True), 6)
    assert late == usual[: len(late)] and len(late) == len(usual) - 2


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("offset", 0.2, 0.02),  # a tenth of a second after its begin
        ("jump", 0.2, 0.2),
        ("wrap", 0.0, 2.0 * pi),
        ("nan", 0.0, np.nan),
    ],
)
@pytest.mark.parametrize("axis", [0, 4, 12])
def test_feedback_of_one_axis_is_wrong(
    controller_client: Maker, kind: str, value: float, expected: float, axis: int
) -> None:
    client = controller_client(ServerFault(kind, at=0.1, value=value, axis=axis))
    assert np.array_equal(client.feedback(), np.zeros(13))
    client.feedback(0.075)
    wrong = np.zeros(13)
    wrong[axis] = expected
    np.testing.assert_allclose(client.feedback(0.1), wrong, atol=1e-6)


def test_the_feedback_for_all_groups_is_as_wrong(controller_client: Maker) -> None:
    client = controller_client(ServerFault("nan", axis=8))
    whole = next(m for m in client.read("state") if m.type == 2017)
    groups = MultiFeedback.of(whole).groups
    assert groups[1].positions is not None and np.isnan(groups[1].positions[1])
    assert groups[0].positions == (0.0,) * 10


def test_feedback_freezes_while_its_stamps_go_on(controller_client: Maker) -> None:
    client = controller_client(ServerFault("freeze", at=0.05), stamps=True)
    first, second = np.full(13, 0.1), np.full(13, 0.2)
    client.poll(0.05, measured=first)
    client.poll(0.025, measured=second)
    bodies = [FeedbackBody.of(m) for m in client.read("state") if m.type == 15]
    assert bodies[-1].positions[0] == pytest.approx(0.1)
    assert bodies[-1].velocities == (0.0,) * 10
    assert bodies[-1].time > bodies[-4].time


def test_feedback_in_degrees(controller_client: Maker) -> None:
    client = controller_client(ServerFault("degrees"))
    client.read("state")
    client.poll(0.025, measured=np.full(13, 0.5), velocities=np.full(13, 0.25))
    body = FeedbackBody.of(client.read("state")[0])
    assert body.positions[0] == pytest.approx(28.6479, abs=1e-3)
    assert body.velocities[0] == pytest.approx(14.3239, abs=1e-3)


def test_feedback_of_other_groups_than_the_robot_has(controller_client: Maker) -> None:
    two = controller_client(ServerFault("groups"))
    messages = two.read("state")
    assert [m.type for m in messages] == [15, 15, 2017, 13]
    assert len(MultiFeedback.of(messages[2]).groups) == 2
    seventh = controller_client(ServerFault("groups", value=0.3, axis=6))
    messages = seventh.read("state")
    assert FeedbackBody.of(messages[0]).positions[6] == pytest.approx(0.3)
    assert MultiFeedback.of(messages[3]).groups[0].positions[6] == pytest.approx(0.3)
    assert FeedbackBody.of(messages[1]).positions[6] == 0.0


# ---------------------------------------------------------------- answers


@pytest.mark.parametrize(
    ("kind", "value", "answer"),
    [("busy", 0.0, (1, 0)), ("not_ready", 5007.0, (5, 5007)), ("not_ready", 0.0, (5, 5000))],
)
def test_points_are_not_taken(
    controller_client: Maker, kind: str, value: float, answer: tuple[int, int]
) -> None:
    client = controller_client(ServerFault(kind, points=2, value=value))
    client.start()
    client.move(0)
    client.move(1)
    client.poll(0.004)
    before = len(client.controller.messages)
    assert client.move(2) == [answer] * 3
    assert len(client.controller.messages) == before + 3  # what came is remembered all the same
    assert client.controller.points == 2
    ready = MotionReply.of(client.ask(READY)[0])
    assert (ready.result, ready.subcode) == ((0, 0) if kind == "busy" else (2, answer[1]))


def test_first_points_do_not_match(controller_client: Maker) -> None:
    client = controller_client(ServerFault("start_mismatch"))
    client.start()
    assert client.move(0) == [(3, 3011)] * 3
    assert client.controller.points == 0


def test_replies_are_to_another_point(controller_client: Maker) -> None:
    client = controller_client(ServerFault("wrong_sequence", at=0.05))
    assert MotionReply.of(client.ask(READY)[0]).sequence == 5
    client.poll(0.05)
    assert MotionReply.of(client.ask(READY)[0]).sequence != 5


def test_outputs_are_lost_and_inputs_stay_off(controller_client: Maker) -> None:
    client = controller_client(ServerFault("lost_outputs"), ServerFault("no_close"))
    client.controller.inputs[25010] = 1
    client.controller.outputs[10011] = 1
    (reply,) = client.ask(WriteIo(10010, 1).to_message(), "io")
    assert WriteIoReply.of(reply).result == 0 and 10010 not in client.controller.outputs
    for address, value in ((25010, 0), (10011, 1)):
        (reply,) = client.ask(ReadIo(address).to_message(), "io")
        assert ReadIoReply.of(reply).value == value


# ---------------------------------------------------------------- pendant


@pytest.mark.parametrize(
    ("kind", "subcode", "shown"),
    [
        ("e_stop", 5003, {"e_stopped": 1, "drives_powered": 0}),
        ("teach", 5004, {"mode": 1, "drives_powered": 0}),
        ("remote_off", 5005, {"drives_powered": 0}),
        ("hold", 5007, {"drives_powered": 1}),
        ("alarm", 5001, {"in_error": 1, "error_code": 4000, "drives_powered": 0}),
    ],
)
def test_the_pendant_stops_the_robot_until_the_fault_ends(
    controller_client: Maker, kind: str, subcode: int, shown: dict[str, int]
) -> None:
    client = controller_client(ServerFault(kind, at=0.6, until=1.5))
    client.start()
    for sequence in range(30):
        client.move(sequence)
    while client.now < 100.6:
        client.poll(0.004)
    client.read("state")
    status = _status(client)
    assert {name: getattr(status, name) for name in shown} == shown
    assert status.motion_possible == 0
    assert _refused(client) == (5, subcode)
    assert client.controller.queued == (0, 0, 0)
    for _ in range(40):
        client.poll(0.025)
    client.read("state")
    # What stopped the job has ended it: it has to be started once more.
    assert _status(client).motion_possible == 0 or kind == "hold"
    assert not client.controller.moving
    client.start()
    client.read("state")
    assert _status(client).motion_possible == 1
    assert [kind in text for _, text in client.server.events if "fault" in text] == [True, True]


def test_an_emergency_stop_that_is_released_leaves_the_servos_off(
    controller_client: Maker,
) -> None:
    client = controller_client(ServerFault("e_stop_released", at=0.5, value=0.1))
    client.start()
    client.poll(0.1)
    client.read("state")
    assert _status(client).e_stopped == 1
    client.poll(0.1)
    client.read("state")
    status = _status(client)
    assert (status.e_stopped, status.drives_powered) == (0, 0)
    assert MotionReply.of(client.ask(READY)[0]).subcode == 5006


def test_servos_are_switched_off(controller_client: Maker) -> None:
    client = controller_client(ServerFault("servo_off", points=1))
    client.start()
    client.move(0)
    client.poll(0.004)
    assert client.move(1) == [(5, 5006)] * 3


# ---------------------------------------------------------------- faults as texts


def test_faults_are_read_from_texts() -> None:
    assert ServerFault.parse("e_stop@5") == ServerFault("e_stop", at=5.0)
    assert ServerFault.parse("busy@2-3.5") == ServerFault("busy", at=2.0, until=3.5)
    assert ServerFault.parse("not_ready=5007") == ServerFault("not_ready", value=5007.0)
    assert ServerFault.parse("delay=0.2@1-") == ServerFault("delay", at=1.0, value=0.2, until=inf)


@pytest.mark.parametrize(
    ("text", "words"),
    [("fire@5", "fault 'fire' is unknown"), ("busy@x", "write KIND"), ("busy@nan", "numbers")],
)
def test_faults_that_cannot_be_are_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ServerFault.parse(text)


def test_faults_can_be_added_while_it_runs(controller_client: Maker) -> None:
    client = controller_client()
    client.poll(0.5)
    client.server.commit(ServerFault("hold", at=0.6))
    client.poll(0.05)
    assert not client.controller.pendant.hold
    client.poll(0.05)
    assert client.controller.pendant.hold


def test_an_axis_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="axis 13"):
        ServerFault("nan", axis=13)


def test_every_kind_says_what_it_does_and_is_tried_here() -> None:
    tried = Path(__file__).read_text(encoding="utf-8")
    for kind, text in KINDS.items():
        assert text and f'"{kind}"' in tried, kind
