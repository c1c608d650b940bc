"""Faults N4 and N5: bytes that come in pieces, and bytes that are no messages."""

import socket
from collections.abc import Callable

import numpy as np

from tests.robustness.faults import frames
from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import WAY, Rig, swing
from tests.robustness.rig.fault import Case, Fault
from unwrinkle.simulation.controllers.server import ServerFault
from unwrinkle.simulation.devices.serial_pan_tilt import VirtualSerialPanTilt

#: Points of the standard motion after which faults begin.
POINTS = 45
#: Random byte streams: into the framer, and into each port of the server.
STREAMS, SERVER_STREAMS = 10000, 100


def partial(case: Case) -> None:
    """N4: partial frames."""
    frames.split_frames(case)
    traces = []
    for faults in ((), (ServerFault("split"),)):
        ex = {"profile": "ex"}  # whose answers in pieces come in time
        name = f"split{len(faults)}"
        with Rig(case.folder, *faults, site=ex, name=name, step=0.002) as rig:
            case.need(rig.connect(), "the driver gets ready", rig.status.reason)
            number = rig.run(swing(rig.start, 0.2 * WAY, 0.4))
            checks.completed(case, rig, number, "the motion runs to its end")
            traces.append(rig.streams())
    same = all(
        np.array_equal(a.positions, b.positions) and np.array_equal(a.times, b.times)
        for a, b in zip(*traces, strict=True)
    )
    case.expect(same, "byte by byte it sends the same points as whole")


def garbage(case: Case) -> None:
    """N5: garbage frames."""
    frames.spoilt_frames(case)
    frames.random_streams(case, STREAMS)
    _noise_to_server(case)
    _noise_to_unit(case)

    def spoilt(kind: str, value: float, *words: str) -> Callable[[], None]:
        def play() -> None:
            fault = ServerFault(kind, points=POINTS, value=value)
            with Rig(case.folder, fault, name=f"{kind}{value:g}") as rig:
                checks.under_way(case, rig, 0.2)
                checks.faulted(case, rig, *words)
                # Garbage on the state connection leaves a way to brake along the path.
                braking = value == 0.0 and kind != "wrong_sequence"
                near = checks.ON_PATH if braking else checks.NEAR_PATH
                checks.stopped(case, rig, near=near, braking=braking)

        return play

    kinds = {
        f"{kind} on {port}": spoilt(kind, value, "garbage")
        for kind in ("garbage", "wrong_length", "huge_length", "wrong_type")
        for port, value in (("state", 0.0), ("motion", 1.0))
    }
    kinds["wrong_sequence"] = spoilt("wrong_sequence", 0.0)
    checks.each(case, kinds)


def _noise_to_server(case: Case) -> None:
    """Random bytes to each port of the server, while another client runs a motion."""
    rng = case.rng
    with Rig(case.folder, name="noise") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        # The server serves four state connections; the driver has one of them.
        for port in (rig.site.state_port, rig.site.io_port, rig.site.motion_port):
            for _ in range(SERVER_STREAMS):
                with socket.create_connection(("127.0.0.1", port), timeout=1.0) as peer:
                    peer.sendall(rng.bytes(int(rng.integers(1, 400))))
                    rig.world()
                    rig.world()
        before = rig.controller.points
        moved = not np.array_equal(rig.controller.positions, rig.start)
        case.expect(
            before == 0 and not moved,
            f"{3 * SERVER_STREAMS} random streams to the controller's ports move nothing",
            (before, moved),
        )
        case.expect(len(rig.server.rejected) > 0, "they are rejected by name", rig.server.rejected)


def _noise_to_unit(case: Case) -> None:
    """Random bytes to a virtual pan-tilt unit."""
    rng, unit = case.rng, VirtualSerialPanTilt()
    crashes = longest = 0
    for k in range(SERVER_STREAMS):
        try:
            longest = max(longest, len(unit.receive(rng.bytes(400), 0.01 * k)))
        except Exception:  # noqa: BLE001  what comes is counted
            crashes += 1
    case.expect(crashes == 0, "random bytes to a pan-tilt unit: no crash", crashes)
    case.expect(longest < 1 << 16, "its answers are bounded", longest)


FAULTS = (
    Fault(
        "N4",
        "partial frames",
        "all splits in two, random splits, and a run in single bytes",
        "framer reassembles; identical result",
        partial,
    ),
    Fault(
        "N5",
        "garbage frames",
        "random bytes, wrong and huge lengths, wrong types and sequences, on both connections; "
        f"{STREAMS} random streams to the framer, {3 * SERVER_STREAMS} to the server",
        "rejected with a named reason, bounded memory, connection closed, never obeyed",
        garbage,
    ),
)
