"""The controller's messages: golden bytes written by hand, round trips, any split, garbage."""

import itertools
import struct
from math import inf, nan

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from unwrinkle.hardware.motoros.messages import (
    SUBCODES,
    Command,
    CommType,
    FeedbackBody,
    Framer,
    GroupPoint,
    IoReply,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    MultiFeedback,
    MultiPoint,
    ReadIo,
    ReadIoGroup,
    ReadIoGroupReply,
    ReadIoReply,
    ReplyCode,
    Result,
    RobotStatusBody,
    Subcode,
    TrajectoryPoint,
    WireError,
    WriteIo,
    WriteIoGroup,
    WriteIoGroupReply,
    WriteIoReply,
    describe,
    ping,
)

_REPLY = (CommType.REPLY, ReplyCode.SUCCESS)
_NONE = "00000000"
# 1, 2, -1, then zeros: ten joints.
_JOINTS = "0000803f 00000040 000080bf" + 7 * _NONE
_SPEEDS = "0000003f" + 9 * _NONE  # 0.5
_NO_JOINTS = 10 * _NONE
_MINUS_ONE = "ffffffff"
_BLOCK = "01000000 07000000 0000803e" + _JOINTS + _SPEEDS + _NO_JOINTS  # group 1, time 0.25 s

GOLDEN = {
    "ping": (ping(), "0c000000 01000000 02000000 00000000"),
    "ping reply": (ping(*_REPLY), "0c000000 01000000 03000000 01000000"),
    "status": (
        RobotStatusBody(1, 0, 4107, -1, 0, 2, 1).to_message(),
        "28000000 0d000000 01000000 00000000 01000000 00000000 0b100000"
        + _MINUS_ONE
        + "00000000 02000000 01000000",
    ),
    "point": (
        TrajectoryPoint(1, 258, 0.25, (1.0, 2.0, -1.0), (0.5,)).to_message(),
        "94000000 0e000000 02000000 00000000 01000000 02010000 07000000 0000803e"
        + _JOINTS
        + _SPEEDS
        + _NO_JOINTS,
    ),
    "point with accelerations, without a time": (
        TrajectoryPoint(2, 0, None, (0.5,), (), (1.0, 2.0, -1.0)).to_message(),
        "94000000 0e000000 02000000 00000000 02000000 00000000 0e000000 00000000"
        + _SPEEDS
        + _NO_JOINTS
        + _JOINTS,
    ),
    "feedback": (
        FeedbackBody(1, 0.25, (1.0, 2.0, -1.0), (0.5,)).to_message(),
        "90000000 0f000000 01000000 00000000" + _BLOCK,
    ),
    "control": (
        MotionControl(-1, 7, Command.STOP_MOTION).to_message(),
        "40000000 d1070000 02000000 00000000" + _MINUS_ONE + "07000000 af0d0300" + _NO_JOINTS,
    ),
    "motion reply": (
        MotionReply(2, 5, 14, Result.INVALID, Subcode.INVALID_START, (0.5,)).to_message(
            reply=ReplyCode.FAILURE
        ),
        "48000000 d2070000 03000000 02000000 02000000 05000000 0e000000 03000000 c30b0000"
        + _SPEEDS,
    ),
    "point of two groups": (
        MultiPoint(
            3,
            (
                GroupPoint(1, 0.25, (1.0, 2.0, -1.0), (0.5,)),
                GroupPoint(1, 0.25, (1.0, 2.0, -1.0), (0.5,)),
            ),
        ).to_message(),
        "1c010000 e0070000 02000000 00000000 02000000 03000000" + 2 * _BLOCK,
    ),
    "feedback of one group in four slots": (
        MultiFeedback((FeedbackBody(1, 0.25, (1.0, 2.0, -1.0), (0.5,)),)).to_message(),
        "20020000 e1070000 01000000 00000000 01000000" + _BLOCK + 99 * _NONE,
    ),
    "read": (ReadIo(25010).to_message(), "10000000 d3070000 02000000 00000000 b2610000"),
    "read reply": (
        ReadIoReply(1, 1001).to_message(reply=ReplyCode.FAILURE),
        "14000000 d4070000 03000000 02000000 01000000 e9030000",
    ),
    "write": (
        WriteIo(10010, 1).to_message(),
        "14000000 d5070000 02000000 00000000 1a270000 01000000",
    ),
    "write reply": (
        WriteIoReply(0).to_message(reply=ReplyCode.SUCCESS),
        "10000000 d6070000 03000000 01000000 00000000",
    ),
    "read group": (ReadIoGroup(2501).to_message(), "10000000 d7070000 02000000 00000000 c5090000"),
    "read group reply": (
        ReadIoGroupReply(255, 0).to_message(reply=ReplyCode.SUCCESS),
        "14000000 d8070000 03000000 01000000 ff000000 00000000",
    ),
    "write group": (
        WriteIoGroup(1001, 3).to_message(),
        "14000000 d9070000 02000000 00000000 e9030000 03000000",
    ),
    "write group reply": (
        WriteIoGroupReply(1003).to_message(reply=ReplyCode.FAILURE),
        "10000000 da070000 03000000 02000000 eb030000",
    ),
    "I/O reply": (
        IoReply(3, 3003).to_message(reply=ReplyCode.FAILURE),
        "14000000 db070000 03000000 02000000 03000000 bb0b0000",
    ),
}
# On the wire, the length's own four bytes included.
TOTALS = {"ping": 16, "status": 44, "point": 152, "feedback": 148, "control": 68}
TOTALS |= {"motion reply": 76, "point of two groups": 24 + 2 * 132, "read": 20, "write": 24}
TOTALS |= {"feedback of one group in four slots": 548, "read reply": 24, "write reply": 20}
READERS = {
    MessageType.ROBOT_STATUS: RobotStatusBody,
    MessageType.JOINT_TRAJ_PT_FULL: TrajectoryPoint,
    MessageType.JOINT_FEEDBACK: FeedbackBody,
    MessageType.MOTION_CTRL: MotionControl,
    MessageType.MOTION_REPLY: MotionReply,
    MessageType.JOINT_TRAJ_PT_FULL_EX: MultiPoint,
    MessageType.JOINT_FEEDBACK_EX: MultiFeedback,
    MessageType.READ_IO_BIT: ReadIo,
    MessageType.READ_IO_BIT_REPLY: ReadIoReply,
    MessageType.WRITE_IO_BIT: WriteIo,
    MessageType.WRITE_IO_BIT_REPLY: WriteIoReply,
    MessageType.READ_IO_GROUP: ReadIoGroup,
    MessageType.READ_IO_GROUP_REPLY: ReadIoGroupReply,
    MessageType.WRITE_IO_GROUP: WriteIoGroup,
    MessageType.WRITE_IO_GROUP_REPLY: WriteIoGroupReply,
    MessageType.IO_CTRL_REPLY: IoReply,
}
ALL = [message for message, _ in GOLDEN.values()]
STREAM = b"".join(message.encode() for message in ALL)


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes(name: str) -> None:
    message, text = GOLDEN[name]
    data = bytes.fromhex(text)
    assert message.encode() == data
    assert len(data) == TOTALS.get(name, len(data))
    assert Framer().feed(data) == [message]
    if message.type != MessageType.PING:
        body = READERS[message.type].of(message)
        assert body.to_message(message.comm, message.reply) == message


def test_the_form_of_four_slots_says_the_same() -> None:
    point = MultiPoint(9, (GroupPoint(0, 1.0, (0.25,), (0.5,)), GroupPoint(2, 1.0, (1.0,), (2.0,))))
    message = point.to_message(four_slots=True)
    assert len(message.encode()) == 552
    assert MultiPoint.of(message) == point


def test_fields_that_are_not_valid_are_none() -> None:
    point = TrajectoryPoint.of(TrajectoryPoint(0, 1, None, None, (0.5,)).to_message())
    assert (point.time, point.positions, point.accelerations) == (None, None, None)
    assert point.velocities == (0.5, *([0.0] * 9))
    assert point.valid == 4


# ---------------------------------------------------------------- splits

_integers = st.integers(-(2**31), 2**31 - 1)
_floats = st.floats(width=32, allow_nan=False, allow_infinity=False)
_joints = st.none() | st.lists(_floats, min_size=10, max_size=10).map(tuple)
_times = st.none() | _floats
_groups = st.builds(GroupPoint, _integers, _times, _joints, _joints, _joints)
_bodies = st.one_of(
    st.builds(RobotStatusBody, *[_integers] * 7),
    st.builds(TrajectoryPoint, _integers, _integers, _times, _joints, _joints, _joints),
    st.builds(FeedbackBody, _integers, _times, _joints, _joints, _joints),
    st.builds(MultiPoint, _integers, st.lists(_groups, min_size=1, max_size=4).map(tuple)),
    st.builds(MotionControl, _integers, _integers, _integers),
    st.builds(MotionReply, *[_integers] * 5),
    st.builds(WriteIo, _integers, _integers),
    st.builds(ReadIoReply, _integers, _integers),
)


def _fed(data: bytes, cuts: list[int], **options: bool) -> tuple[list[Message], str]:
    """Messages of a stream that comes in pieces, and the name of the garbage that ended it."""
    framer, messages = Framer(**options), []
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for begin, end in itertools.pairwise(edges):
        try:
            messages += framer.feed(data[begin:end])
        except WireError as error:
            return messages + list(error.messages), error.name
    return messages, ""


def test_every_split_in_two_gives_the_same_messages() -> None:
    for cut in range(len(STREAM) + 1):
        assert _fed(STREAM, [cut]) == (ALL, "")


def test_single_bytes_give_the_same_messages() -> None:
    assert _fed(STREAM, list(range(len(STREAM)))) == (ALL, "")


@settings(max_examples=150, deadline=None)
@given(st.lists(_bodies, max_size=6), st.lists(st.integers(0, 10**6), max_size=12))
def test_any_bodies_in_any_pieces_come_out_as_they_went_in(
    bodies: list[TrajectoryPoint], cuts: list[int]
) -> None:
    messages = [body.to_message() for body in bodies]
    out, garbage = _fed(b"".join(message.encode() for message in messages), cuts)
    assert (out, garbage) == (messages, "")
    assert [READERS[message.type].of(message) for message in out] == bodies


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=64), st.integers(0, len(ALL)), st.lists(st.integers(0, 10**6)))
@example(b"\x0c\0\0\0\x63\0\0\0", 2, [1])
def test_garbage_ends_every_split_of_a_stream_alike(
    garbage: bytes, whole: int, cuts: list[int]
) -> None:
    data = b"".join(message.encode() for message in ALL[:whole]) + garbage
    assert _fed(data, cuts) == _fed(data, [])


# ---------------------------------------------------------------- garbage


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ((11,), "length"),
        ((-1,), "length"),
        ((0x7FFFFFFF,), "length"),
        ((4097,), "length"),
        ((12, 99), "type"),
        ((12, -1), "type"),
        ((13, 1), "length"),
        ((148, 15), "length"),
        ((12, 1, 0), "comm"),
        ((12, 1, 4), "comm"),
        ((12, 1, 2, 3), "reply"),
        ((12, 1, 2, -1), "reply"),
    ],
)
def test_garbage_is_named_as_soon_as_it_shows(words: tuple[int, ...], name: str) -> None:
    framer = Framer()
    bad = struct.pack(f"<{len(words)}i", *words)
    assert framer.feed(bad[:-1]) == []
    with pytest.raises(WireError) as caught:
        framer.feed(bad[-1:])
    assert caught.value.name == name
    assert framer.waiting == 0
    with pytest.raises(WireError) as again:  # for good
        framer.feed(ping().encode())
    assert again.value.name == name


def test_messages_before_garbage_come_with_the_error() -> None:
    with pytest.raises(WireError) as caught:
        Framer().feed(ping().encode() + ReadIo(1).to_message().encode() + b"\xff" * 4)
    assert [message.type for message in caught.value.messages] == [1, 2003]


def test_unknown_types_pass_a_lenient_framer_alone() -> None:
    odd = Message(3777, CommType.REQUEST, 0, b"abc")
    assert Framer(lenient=True).feed(odd.encode()) == [odd]
    with pytest.raises(WireError, match="unknown type 3777"):
        Framer().feed(odd.encode())


def test_a_framer_keeps_no_more_than_a_message() -> None:
    framer = Framer(most=552)
    for _ in range(200):
        framer.feed(STREAM)
        assert framer.waiting <= 556


def test_ten_thousand_random_streams_never_crash_or_fill_the_framer() -> None:
    random = np.random.default_rng(5)
    names, whole = set(), 0
    for number in range(10_000):
        if number % 2:  # a valid stream with some bytes changed
            data = bytearray(ALL[number % len(ALL)].encode() * 2)
            for place in random.integers(0, len(data), 1 + number % 3):
                data[place] = random.integers(0, 256)
        else:
            data = bytearray(random.bytes(int(random.integers(0, 200))))
        out, name = _fed(bytes(data), list(random.integers(0, 10**6, 3)), lenient=number % 3 == 0)
        names.add(name)
        whole += len(out)
        for message in out:
            if message.type in READERS:
                try:
                    READERS[message.type].of(message)
                except WireError as error:
                    names.add(error.name)
    assert names == {"", "length", "type", "comm", "reply", "valid", "groups"}
    assert whole > 1000


# ---------------------------------------------------------------- bodies that cannot be


@pytest.mark.parametrize("value", [nan, inf, -inf, 1e39, -3.5e38])
def test_numbers_that_are_not_finite_are_never_encoded(value: float) -> None:
    for body in (
        TrajectoryPoint(0, 0, 0.0, (0.0, value), (0.0,)),
        TrajectoryPoint(0, 0, value, (0.0,), (0.0,)),
        MotionControl(0, 0, 1, (value,)),
        MultiPoint(0, (GroupPoint(0, 0.0, (0.0,), (value,)),)),
    ):
        with pytest.raises(WireError) as caught:
            body.to_message()
        assert caught.value.name == "not finite"


def test_numbers_that_are_not_finite_are_read() -> None:
    message = FeedbackBody(0, 0.0, (1.0,)).to_message()
    body = message.body[:12] + struct.pack("<f", nan) + message.body[16:]
    positions = FeedbackBody.of(Message(message.type, 1, 0, body)).positions
    assert positions is not None and np.isnan(positions[0])


def test_integers_beyond_32_bits_are_refused() -> None:
    with pytest.raises(WireError) as caught:
        WriteIo(2**31, 0).to_message()
    assert caught.value.name == "integer"


@pytest.mark.parametrize("count", [0, 5, -1, 3])
def test_a_wrong_number_of_groups_is_refused(count: int) -> None:
    message = MultiPoint(0, (GroupPoint(0, 0.0, (0.0,), (0.0,)),)).to_message()
    wrong = Message(message.type, 2, 0, struct.pack("<i", count) + message.body[4:])
    with pytest.raises(WireError) as caught:
        MultiPoint.of(wrong)
    assert caught.value.name == "groups"


def test_unknown_valid_bits_and_other_types_are_refused() -> None:
    message = TrajectoryPoint(0, 0, 0.0, (0.0,), (0.0,)).to_message()
    body = message.body[:8] + struct.pack("<i", 16) + message.body[12:]
    with pytest.raises(WireError, match="valid fields"):
        TrajectoryPoint.of(Message(message.type, 2, 0, body))
    with pytest.raises(WireError, match="where 15 is expected"):
        FeedbackBody.of(message)
    with pytest.raises(WireError, match="a body of 3 bytes"):
        ReadIo.of(Message(MessageType.READ_IO_BIT, 2, 0, b"abc"))
    with pytest.raises(WireError, match="11 joints"):
        GroupPoint(0, 0.0, (0.0,) * 11)


def test_every_code_has_words() -> None:
    assert set(SUBCODES) == set(map(int, Subcode))
    for result in Result:
        assert describe(result, 0)
    assert describe(5, 5003).startswith("an emergency stop is pressed; release it, then reset")
    assert "5003" in describe(5, 5003)
    assert describe(3, 3011).startswith("the first point is not where")
    assert "unknown result" in describe(99)
    assert describe(0, 17) == "done"
