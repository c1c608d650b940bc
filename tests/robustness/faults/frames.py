"""Faults N4 and N5, the part of the framer: split, spoilt and random bytes."""

import struct
import tracemalloc

import numpy as np

from tests.robustness.rig.fault import Case
from unwrinkle.hardware.motoros.messages import (
    Command,
    FeedbackBody,
    Framer,
    Message,
    MotionControl,
    RobotStatusBody,
    TrajectoryPoint,
    WireError,
)

#: Bytes that a framer may hold.
MOST = 4096


def stream(rng: np.random.Generator, count: int = 12) -> tuple[list[Message], bytes]:
    """Messages of four kinds in a random order, and their bytes."""
    messages = []
    for k in range(count):
        q, v = (tuple(float(x) for x in rng.uniform(-2.0, 2.0, 6)) for _ in range(2))
        kind = int(rng.integers(4))
        if kind == 0:
            messages.append(FeedbackBody(k % 3, 0.1 * k, q, v).to_message())
        elif kind == 1:
            messages.append(RobotStatusBody(1, 0, 0, 0, 1, 2, 1).to_message())
        elif kind == 2:
            messages.append(TrajectoryPoint(k % 3, k, 0.1 * k, q, v).to_message())
        else:
            messages.append(MotionControl(-1, k, Command.STOP_MOTION).to_message())
    return messages, b"".join(message.encode() for message in messages)


def feed(data: bytes, *, lenient: bool = False, parts: int = 0) -> tuple[list[Message], str]:
    """What a framer makes of bytes, in so many equal parts.

    And the name of the error that ended it.
    """
    framer = Framer(MOST, lenient=lenient)
    found: list[Message] = []
    step = max(1, -(-len(data) // parts)) if parts else max(1, len(data))
    try:
        for k in range(0, len(data), step):
            found += framer.feed(data[k : k + step])
    except WireError as error:
        return found + list(error.messages), error.name
    return found, ""


def split_frames(case: Case) -> None:
    """Any split gives the same messages."""
    messages, data = stream(case.rng)
    case.need(feed(data) == (messages, ""), "the messages come back as they were")
    bad = 0
    for cut in range(len(data) + 1):
        framer = Framer(MOST)
        bad += framer.feed(data[:cut]) + framer.feed(data[cut:]) != messages
    case.expect(bad == 0, f"all {len(data) + 1} splits in two give the same messages", bad)
    case.expect(
        feed(data, parts=len(data)) == (messages, ""), "single bytes give the same messages"
    )
    rng, differ = case.rng, 0
    for _ in range(200):
        cuts = np.sort(rng.integers(0, len(data) + 1, 8))
        framer = Framer(MOST)
        found = []
        for part in np.split(np.frombuffer(data, np.uint8), cuts):
            found += framer.feed(part.tobytes())
        differ += found != messages
    case.expect(differ == 0, "200 random splits in nine give the same messages", differ)


def spoilt_frames(case: Case) -> None:
    """Garbage is refused with a name."""
    rng = case.rng
    _, data = stream(rng, 3)
    first = struct.unpack("<i", data[:4])[0] + 4
    cases = {
        "a random prefix": rng.bytes(40) + data,
        "a wrong length": struct.pack("<i", first + 1) + data[4:],
        "a huge length": struct.pack("<i", 0x7FFFFFFF) + data[4:],
        "a negative length": struct.pack("<i", -20) + data[4:],
        "an unknown type": data[:4] + struct.pack("<i", 9999) + data[8:],
        "an unknown comm type": data[:8] + struct.pack("<i", 77) + data[12:],
        "an unknown reply code": data[:12] + struct.pack("<i", 77) + data[16:],
    }
    for name, spoilt in cases.items():
        found, error = feed(spoilt)
        case.expect(error != "" and not found, f"{name} is refused by name", (error, len(found)))


def random_streams(case: Case, count: int) -> None:
    """Random bytes, bare, and with good messages around them: no crash, no unbounded memory."""
    rng = case.rng
    good, data = stream(rng, 2)
    crashes = obeyed = unbounded = 0
    tracemalloc.start()
    for k in range(count):
        noise = rng.bytes(int(rng.integers(1, 200)))
        spoilt = noise if k % 2 else data + noise
        lenient = k % 4 >= 2  # a server's, which lets unknown types pass
        framer = Framer(MOST, lenient=lenient)
        found: list[Message] = []
        try:
            for part in (spoilt[:7], spoilt[7:], rng.bytes(64)):
                found += framer.feed(part)
        except WireError as error:
            found += list(error.messages)
        except Exception:  # noqa: BLE001  what comes is counted
            crashes += 1
        wanted = [] if k % 2 else good
        obeyed += found[: len(wanted)] != wanted or (not lenient and found != wanted)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    unbounded += peak > 50e6
    case.expect(crashes == 0, f"{count} random streams: no crash", crashes)
    case.expect(obeyed == 0, "no garbage is taken for a message", obeyed)
    case.expect(unbounded == 0, "memory stays bounded", f"{peak / 1e6:.0f} MB")
