"""Faults S1 to S5: feedback that is old, off, late, jumps or is no number."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import Rig
from tests.robustness.rig.fault import Case, Fault
from unwrinkle.hardware import controller_state
from unwrinkle.simulation.controllers.server import ServerFault

#: Points of the standard motion after which faults begin.
POINTS = 45
#: The axis that goes wrong: the left arm's second.
AXIS, AXIS_NAME = 8, "r2_l"


def _stops(
    case: Case,
    fault: ServerFault,
    *words: str,
    near: float = checks.NEAR_PATH,
    braking: bool = False,
    **options: Any,
) -> Callable[[], None]:
    """An injection during the standard motion that has to end in a fault, the arms at rest."""

    def play() -> None:
        name = f"{fault.kind}{fault.value:g}"
        with Rig(case.folder, fault, name=name, **options) as rig:
            checks.under_way(case, rig, 0.2)
            checks.faulted(case, rig, *words)
            # "No chase": what is commanded stays on the path, whatever the feedback says.
            checks.stopped(case, rig, near=near, braking=braking)

    return play


def frozen(case: Case) -> None:
    """S1: stale feedback with fresh stamps."""
    _stops(case, ServerFault("freeze", points=POINTS), "off its path", "rad")()


def following(case: Case) -> None:
    """S2: following error of one joint."""
    checks.each(
        case,
        {
            "one axis drifts off": _stops(
                case,
                ServerFault("offset", points=POINTS, value=0.3, axis=AXIS),
                AXIS_NAME,
                "off its path",
                "at most 0.02 rad",
            ),
        },
    )


def latency(case: Case) -> None:
    """S3: latency steps from 10 to 80 ms."""

    def runs() -> None:
        # 10 ms from the beginning, 80 ms from the midst of the motion on.
        faults = (
            ServerFault("delay", value=0.010, until=0.9),
            ServerFault("delay", at=0.9, value=0.060),
        )
        with Rig(case.folder, *faults, name="below") as rig:
            case.need(rig.connect(), "the driver gets ready", rig.status.reason)
            number = rig.run()
            checks.completed(case, rig, number, "no false fault below the declared latency")
            lag = rig.status.lag
            case.expect(lag > 0.0, "the lag is told", f"{1e3 * lag:.0f} ms")

    checks.each(
        case,
        {
            "10 to 80 ms in all": runs,
            "above the latency": _stops(case, ServerFault("delay", points=POINTS, value=0.22)),
        },
    )


def jumps(case: Case) -> None:
    """S4: encoder jump, wrap."""
    checks.each(
        case,
        {
            "0.2 rad": _stops(
                case,
                ServerFault("jump", points=POINTS, value=0.2, axis=AXIS),
                AXIS_NAME,
                "jumped",
            ),
            "a turn": _stops(case, ServerFault("wrap", points=POINTS, axis=6), "r1_t"),
        },
    )


def no_number(case: Case) -> None:
    """S5: feedback NaN, wrong units."""

    def at_connect(kind: str, *words: str) -> Callable[[], None]:
        def play() -> None:
            start = np.full(13, 0.2)
            with Rig(
                case.folder, ServerFault(kind, axis=AXIS), start=start, name=f"{kind}_first"
            ) as rig:
                case.expect(not rig.connect(), "never ready", rig.state)
                case.expect(rig.state == controller_state.FAULT, "a fault latches", rig.state)
                case.reads(rig.status.reason, *words)
                rig.run()
                rig.step(100)
                case.expect(
                    rig.controller.points == 0 and np.array_equal(rig.controller.positions, start),
                    "nothing was sent, nothing has moved",
                    rig.controller.points,
                )

        return play

    checks.each(
        case,
        {
            "NaN at connect": at_connect("nan", "not a finite number"),
            "degrees at connect": at_connect("degrees", "degrees"),
            "NaN under way": _stops(
                case, ServerFault("nan", points=POINTS, axis=AXIS), AXIS_NAME, "not a finite number"
            ),
            "degrees under way": _stops(case, ServerFault("degrees", points=POINTS)),
            "two groups under way": _stops(
                case,
                ServerFault("groups", points=POINTS),
                "groups",
                near=checks.ON_PATH,
                braking=True,
            ),
        },
    )


FAULTS = (
    Fault(
        "S1",
        "stale feedback with fresh stamps",
        f"positions frozen after {POINTS} points, stamps going on",
        "following-error fault",
        frozen,
    ),
    Fault(
        "S2",
        "following error of one joint",
        "feedback of the left arm's second axis drifts off at 0.3 rad/s",
        "coordinated stop; message has joint and bound",
        following,
    ),
    Fault(
        "S3",
        "latency steps from 10 to 80 ms",
        "a delay line of 10, then 60 ms, and one of 220 ms, beside 10 ms of the axes themselves",
        "no false fault below the declared latency; fault above",
        latency,
    ),
    Fault(
        "S4",
        "encoder jump, wrap",
        "0.2 rad and a turn added at once",
        "fault, no chase",
        jumps,
    ),
    Fault(
        "S5",
        "feedback NaN, wrong units",
        "NaN and degrees at the connection and under way",
        "rejected; unit plausibility check at connect",
        no_number,
    ),
)
