"""Faults N1 to N3 and N6 to N9: connections, their replies and their pace."""

import socket
import time
from collections.abc import Callable

import numpy as np

from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import Rig
from tests.robustness.rig.fault import Case, Fault
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.motoros.messages import MessageType, Subcode
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ServerFault

#: Points of the standard motion after which faults begin.
POINTS = 45


def refused(case: Case) -> None:
    """N1: connection refused, wrong port."""
    with Rig(case.folder) as rig:
        state = rig.site.state_port
        rig.server.close()  # nobody listens any more
        rig.serving = False
        clock = time.monotonic()
        try:
            rig.driver.connect()
        except HardwareError as error:
            case.reads(str(error), f"127.0.0.1:{state}", "cannot connect")
        else:
            case.expect(False, "connecting fails", rig.state)
        took = time.monotonic() - clock
        case.expect(took < rig.site.connect_timeout + 1.0, "within the deadline", f"{took:.2f} s")
        case.expect(
            rig.state in (controller_state.OFFLINE, controller_state.FAULT),
            "no motion state",
            rig.state,
        )
        rig.run()
        case.expect(
            rig.state in (controller_state.OFFLINE, controller_state.FAULT)
            and rig.status.completed == 0,
            "a trajectory is refused",
            rig.state,
        )
    with Rig(case.folder, site={"motion_port": _deaf_port()}, name="wrong") as rig:
        ready = rig.connect()
        case.expect(
            not ready and rig.state == controller_state.FAULT, "one wrong port is enough", rig.state
        )
        case.reads(rig.status.reason, f":{rig.site.motion_port}", "cannot connect")


def _deaf_port() -> int:
    """A port on which nobody listens."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def closed(case: Case) -> None:
    """N2: TCP closed mid-trajectory."""

    def close(kind: str, near: float, braking: bool = False) -> Callable[[], None]:
        def play() -> None:
            with Rig(case.folder, ServerFault(kind, points=POINTS), name=kind) as rig:
                checks.under_way(case, rig, 0.2)
                checks.faulted(case, rig, "connection")
                checks.stopped(case, rig, near=near, braking=braking)

        return play

    checks.each(
        case,
        {
            # A controller that loses its motion connection empties the queues: the servos brake.
            "close_motion": close("close_motion", checks.NEAR_PATH),
            "close_state": close("close_state", checks.ON_PATH, True),
            "close_all": close("close_all", checks.NEAR_PATH),
        },
    )


def half_open(case: Case) -> None:
    """N3: half-open link: the peer falls silent."""

    def silent(kind: str, near: float, braking: bool = False) -> Callable[[], None]:
        def play() -> None:
            with Rig(case.folder, ServerFault(kind, points=POINTS), name=kind) as rig:
                checks.under_way(case, rig, 0.2)
                checks.faulted(case, rig)
                begun = next(
                    (t for t, text in rig.server.events if f"fault {kind} begins" in text), None
                )
                case.need(begun is not None, "the peer fell silent")
                assert begun is not None
                silence = 100.0 + begun  # the rig's clock begins there
                hold, fault = (
                    rig.since(s, silence)
                    for s in (controller_state.HOLDING, controller_state.FAULT)
                )
                period = rig.site.feedback_period
                if kind == "silent_state":
                    low, high = rig.site.hold_after - period, rig.site.hold_after + 2 * period
                    case.expect(
                        hold is not None and low <= hold <= high,
                        "it holds once feedback is older than hold_after",
                        f"{hold} s",
                    )
                    low, high = rig.site.fault_after - period, rig.site.fault_after + 2 * period
                    case.expect(
                        fault is not None and low <= fault <= high,
                        "and is in fault once it is older than fault_after",
                        f"{fault} s",
                    )
                else:
                    case.expect(
                        fault is not None and fault <= rig.site.reply_timeout + 0.1,
                        "answers that do not come are a fault no later than an overdue reply",
                        f"{fault} s",
                    )
                heard = kind == "silent_state"
                checks.stopped(case, rig, near=near, braking=braking, heard=heard)

        return play

    checks.each(
        case,
        {
            "silent_state": silent("silent_state", checks.ON_PATH, True),
            "silent_motion": silent("silent_motion", checks.NEAR_PATH),
            "silent": silent("silent", checks.NEAR_PATH),
        },
    )


def reordered(case: Case) -> None:
    """N6: duplicated, reordered, delayed feedback."""

    def run(*faults: ServerFault) -> Callable[[], None]:
        def play() -> None:
            # MotoROS sends no stamps; a controller that does lets the driver sort.
            settings = VirtualControllerSettings(stamps=True)
            with Rig(case.folder, *faults, settings=settings, name=faults[0].kind) as rig:
                case.need(rig.connect(), "the driver gets ready", rig.status.reason)
                number = rig.run()
                stamps, ages = [], []

                def done() -> bool:
                    feedback = rig.driver.feedback
                    if feedback is not None and feedback.stamp is not None:
                        stamps.append(feedback.stamp)
                    ages.append(rig.status.feedback_age)
                    return rig.status.completed >= number or rig.state == controller_state.FAULT

                rig.until(done, 8.0)
                checks.completed(case, rig, number, "the motion runs to its end")
                case.expect(
                    bool(stamps) and bool((np.diff(stamps) >= 0.0).all()), "the newest set counts"
                )
                case.expect(
                    max(ages) <= rig.site.hold_after,
                    "age counts from receipt",
                    f"{max(ages):.3f} s",
                )

        return play

    checks.each(
        case,
        {
            "duplicate": run(ServerFault("duplicate")),
            "reorder": run(ServerFault("reorder")),
            "delay": run(ServerFault("delay", value=0.03)),
        },
    )


def replies(case: Case) -> None:
    """N7: busy, not ready, start position mismatch."""
    with Rig(case.folder, ServerFault("busy", at=0.0, until=1.0), name="busy") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        number = rig.run()
        checks.completed(case, rig, number, "a controller that is busy for a while is asked again")
    with Rig(case.folder, ServerFault("busy"), site={"busy_limit": 0.6}, name="always") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        rig.run()
        checks.faulted(case, rig, "busy")
        tries = rig.points_after(0.0)
        case.expect(tries < 1000, "the attempts are bounded", tries)
        checks.stopped(case, rig)
    for code, words in (
        (Subcode.NOT_READY_E_STOP, "emergency stop is pressed"),
        (Subcode.NOT_READY_HOLD, "hold is pressed"),
        (Subcode.NOT_READY_SERVO_OFF, "servos are off"),
        (Subcode.NOT_READY_ALARM, "alarm"),
    ):
        fault = ServerFault("not_ready", points=POINTS, value=float(code))
        with Rig(case.folder, fault, name=f"not_ready{int(code)}") as rig:
            checks.under_way(case, rig, 0.2)
            checks.faulted(case, rig, words)
            checks.stopped(case, rig, near=checks.NEAR_PATH)
    with Rig(case.folder, ServerFault("start_mismatch"), name="start") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        rig.run()
        rig.until(lambda: rig.state == controller_state.FAULT or bool(rig.status.reason), 3.0)
        case.reads(rig.status.reason, "where the robot is commanded to stand")
        case.expect(
            np.array_equal(rig.controller.positions, rig.start), "nothing has moved", rig.state
        )


def handshake(case: Case) -> None:
    """N8: another robot, joint count, profile."""
    start = np.full(13, 0.2)
    for name, fault, words in (
        ("two groups", ServerFault("groups"), ()),
        ("a joint too many", ServerFault("groups", value=0.3, axis=6), ()),
        ("degrees", ServerFault("degrees"), ("degrees",)),
        ("no feedback", ServerFault("silent"), ("no feedback has come",)),
    ):
        with Rig(case.folder, fault, start=start, name=name) as rig:
            ready = rig.connect(most=4.0)
            case.expect(not ready, f"{name}: never ready", rig.state)
            case.reads(rig.status.reason, *words)
            rig.run()
            rig.step(100)
            case.expect(
                rig.controller.points == 0 and np.array_equal(rig.controller.positions, start),
                f"{name}: refused before any motion",
                rig.controller.points,
            )
    for profile, accepts in (("ex", "groups"), ("groups", "ex")):
        settings = VirtualControllerSettings(accepts=accepts)
        name = f"{profile}_{accepts}"
        with Rig(case.folder, site={"profile": profile}, settings=settings, name=name) as rig:
            if rig.connect(most=4.0):
                rig.run()
                rig.until(
                    lambda: rig.state == controller_state.FAULT or bool(rig.status.reason), 3.0
                )
            case.reads(rig.status.reason)
            case.expect(
                rig.status.reason != "" and np.array_equal(rig.controller.positions, rig.start),
                f"profile {profile} with a controller that takes {accepts}: "
                "said, and nothing moves",
                f"{rig.state} {rig.status.reason}",
            )


def slow(case: Case) -> None:
    """N9: slow consumer, full send buffer."""
    faults = (ServerFault("tiny_buffers"), ServerFault("slow", value=700.0))
    with Rig(case.folder, *faults, name="slow") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        number = rig.run()
        checks.completed(case, rig, number, "a slow reader gets every point")
        sequences = [point.sequence for point in rig.controller.received[0]]
        case.expect(
            sequences == list(range(len(sequences))),
            "none is skipped or sent twice",
            len(sequences),
        )
    faults = (ServerFault("tiny_buffers"), ServerFault("slow", value=40.0, points=POINTS))
    with Rig(case.folder, *faults, name="too_slow") as rig:
        checks.under_way(case, rig, 0.2)
        checks.faulted(case, rig)
        # What is in the sockets cannot be taken back: one point of each group, and the stop after
        # it.
        rig.step(500)
        late = rig.points_after(rig.entered(controller_state.FAULT) or 0.0)
        case.expect(late <= 3, "only the one point that was on its way arrives late", late)
        checks.stopped(case, rig, near=checks.NEAR_PATH, grace=3.0)
        waiting = max((link.waiting for link in rig.driver.links.values()), default=0)
        case.expect(waiting < 4096, "what waits is bounded", waiting)
    kinds = (MessageType.JOINT_TRAJ_PT_FULL, MessageType.JOINT_TRAJ_PT_FULL_EX)
    sent = [m for _, m in rig.controller.messages if m.type in kinds]
    case.expect(bool(sent), "points had been sent before")


FAULTS = (
    Fault(
        "N1",
        "connection refused, wrong port",
        "no listener on any port, and on one of the three",
        "clear error naming host:port within the deadline, no motion state",
        refused,
    ),
    Fault(
        "N2",
        "TCP closed mid-trajectory",
        f"the motion, the state, every connection closed after {POINTS} points",
        "both arms hold, fault latched, log complete",
        closed,
    ),
    Fault(
        "N3",
        "half-open link: the peer falls silent",
        "no answers, no feedback, neither; the sockets stay",
        "hold at N periods, fault at M",
        half_open,
    ),
    Fault(
        "N6",
        "duplicated, reordered, delayed feedback",
        "every set twice, swapped in pairs, 30 ms late",
        "newest by sequence wins; age computed from receive time",
        reordered,
    ),
    Fault(
        "N7",
        "busy, not ready, start position mismatch",
        "scripted replies: busy for a while and for ever, four sub-codes of not ready, 3011",
        "busy retried with bound; others stop with the vendor's reason in plain words",
        replies,
    ),
    Fault(
        "N8",
        "another robot, joint count, profile",
        "feedback of two groups, of a seventh joint, in degrees, none; the other profile",
        "refuse before motion",
        handshake,
    ),
    Fault(
        "N9",
        "slow consumer, full send buffer",
        "smallest socket buffers, and a peer that reads 700 and 40 bytes a poll",
        "back-pressure without skipping points; deadline respected",
        slow,
    ),
)
