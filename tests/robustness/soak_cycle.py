"""One cycle of the soak: a random motion, random overrides, holds and resumes, and one fault at a
random step.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import Rig, swing
from tests.robustness.rig.fault import Case, Different
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.motoros.messages import Subcode
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ServerFault

#: What a cycle must come to.
FAULTED, COMPLETED = "fault", "completed"
#: s on the server's clock at which faults that end are over.
_OVER = 12.0
#: s of one cycle on the fake clock, at most.
_LONGEST = 40.0
#: s after which the points sent are the whole lead ahead of the robot.
_LEAD_BUILT = 0.25
#: Of the limits, what the random motions use at most.
_SHARE = 0.9


@dataclass(frozen=True)
class Kind:
    """A kind of injection.

    Attributes:
        name: of it.
        ends: what the cycle must come to.
        faults: of the server, once so many points were accepted.
        recovers: the cause goes away by itself: a reset and a new trajectory must work.
        sleep: the host sleeps so long, s, in place of a server's fault.
        full_disk: the log cannot be written any more, in place of a server's fault.
        dies: the client dies with its connections, in place of a server's fault.
        late: it takes time that a clock of 8 ms, with a point each 8 ms, does not leave.
    """

    name: str
    ends: str
    faults: Callable[[int], tuple[ServerFault, ...]] = lambda points: ()
    recovers: bool = False
    sleep: float = 0.0
    full_disk: bool = False
    dies: bool = False
    late: bool = False


def _one(
    kind: str, *, over: bool = False, **options: Any
) -> Callable[[int], tuple[ServerFault, ...]]:
    until = _OVER if over else float("inf")
    return lambda points: (ServerFault(kind, points=points, until=until, **options),)


def _stop(name: str, *, over: bool = False, kind: str = "", **options: Any) -> Kind:
    return Kind(name, FAULTED, _one(kind or name, over=over, **options), recovers=over)


KINDS = (
    Kind("none", COMPLETED),
    _stop("close_motion"),
    _stop("close_state"),
    _stop("close_all"),
    _stop("silent"),
    _stop("silent_motion"),
    _stop("silent_state"),
    *(
        _stop(f"{kind} on {port}", kind=kind, value=value)
        for kind in ("garbage", "wrong_length", "huge_length", "wrong_type")
        for port, value in (("state", 0.0), ("motion", 1.0))
    ),
    _stop("wrong_sequence"),
    _stop("freeze", over=True),
    _stop("offset", over=True, value=0.4, axis=8),
    _stop("jump", over=True, value=0.3, axis=3),
    _stop("wrap", over=True, axis=6),
    _stop("nan", over=True, axis=10),
    _stop("degrees", over=True),
    _stop("busy", over=True),
    _stop("not_ready", over=True, value=float(Subcode.NOT_READY_HOLD)),
    _stop("e_stop", over=True),
    Kind("e_stop_released", FAULTED, _one("e_stop_released", value=0.3), recovers=True),
    _stop("teach", over=True),
    _stop("remote_off", over=True),
    _stop("servo_off"),
    _stop("alarm", over=True, value=4100.0),
    _stop("hold", over=True),
    Kind("duplicate", COMPLETED, _one("duplicate")),
    Kind("reorder", COMPLETED, _one("reorder")),
    Kind("delay", COMPLETED, _one("delay", value=0.03)),
    Kind(
        "slow reader",
        COMPLETED,
        lambda points: (
            ServerFault("tiny_buffers"),
            ServerFault("slow", points=points, value=800.0),
        ),
        late=True,
    ),
    Kind("coalesce", COMPLETED, _one("coalesce", value=0.004), late=True),
    _stop("cut", value=60.0),
    Kind("client dies", FAULTED, dies=True),
    Kind("pause of 50 ms", COMPLETED, sleep=0.05, late=True),
    Kind("pause of 0.4 s", FAULTED, sleep=0.4, recovers=True),
    Kind("full disk", FAULTED, full_disk=True),
)


@dataclass
class Cycle:
    """One cycle, filled in while it is played.

    Attributes:
        cycle: its number.
        kind: of the injection.
        expected, ended: `fault` or `completed`.
        reason: of the fault.
        problems: promises that were not kept.
        violations: samples that were sent beyond a limit.
        points: that the controller took.
        changes: of the override, holds and resumes.
        left: increments that were left in the controller's queues when its client was gone.
        moved: greatest angle that an axis moved before it was commanded to, rad.
        recovered: whether a new trajectory ran after it, None where that was not asked.
        seconds: wall clock.
    """

    cycle: int
    kind: str
    expected: str
    ended: str = ""
    reason: str = ""
    problems: list[str] = field(default_factory=list)
    violations: int = 0
    points: int = 0
    changes: int = 0
    left: int = 0
    moved: float = 0.0
    recovered: bool | None = None
    seconds: float = 0.0


def play(folder: Path, seed: int, cycle: int) -> Cycle:
    """Play one cycle; the same seed and number always play the same."""
    rng = np.random.default_rng([seed, cycle])
    # Every kind comes up as often as every other.
    order = np.random.default_rng([seed, 7]).permutation(len(KINDS))
    kind = KINDS[order[cycle % len(KINDS)]]
    result = Cycle(cycle, kind.name, kind.ends)
    clock = time.perf_counter()
    case = Case(folder)
    try:
        _play(case, folder, rng, kind, result)
    except Different:
        pass
    except Exception as error:  # noqa: BLE001  a cycle reports, whatever comes
        case.broken.append(f"{type(error).__name__}: {error}")
    result.problems = case.broken
    result.violations = case.limit_violations
    result.moved = case.moved_before_command
    result.seconds = time.perf_counter() - clock
    return result


def _play(case: Case, folder: Path, rng: np.random.Generator, kind: Kind, result: Cycle) -> None:
    begin = rng.uniform(-0.3, 0.3, 13)
    way = rng.uniform(-1.0, 1.0, 13)
    duration = float(rng.uniform(0.7, 1.4))
    # Points are 8 to 40 ms apart, as the speed changes.
    strike = int(rng.integers(10, int(0.7 * duration / 0.016)))
    faults = kind.faults(strike)
    name = f"cycle{result.cycle}"
    (folder / f"{name}.jsonl").unlink(missing_ok=True)  # of a run before that failed
    # One message a point, where each takes its time.
    profile = "ex" if kind.late else ("groups", "ex")[int(rng.integers(2))]
    firmware = "2013" if profile == "groups" and rng.uniform() < 0.3 else "1.9.12"
    settings = VirtualControllerSettings(
        firmware=firmware,
        delay=float(rng.choice([0.05, 0.15, 0.2])),
        period=0.004 if kind.late else float(rng.choice([0.004, 0.008])),
    )
    site = {"profile": profile, "connect_timeout": 0.6}
    with Rig(folder, *faults, site=site, settings=settings, start=begin, name=name) as rig:
        limits = rig.limits
        # Peaks of the standard law over a way of 1 rad in 1 s: 2.19, 7.6, 53.
        most = np.minimum.reduce(
            [
                limits.velocity * duration / 2.19,
                limits.acceleration * duration**2 / 7.6,
                limits.jerk * duration**3 / 53.0,
            ]
        )
        way *= np.minimum(_SHARE * most, 0.5)
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        number = rig.run(swing(begin, way, duration))
        pending = {"sleep": kind.sleep, "disk": float(kind.full_disk), "dies": float(kind.dies)}
        ended = _drive(rig, rng, number, strike, pending, result)
        result.ended, result.reason = ended, rig.status.reason if ended == FAULTED else ""
        case.expect(ended == kind.ends, f"it ends in {kind.ends}", f"{ended}: {rig.status.reason}")
        rig.settle(6.0)
        off = rig.off_path()
        case.expect(off <= checks.NEAR_PATH, "the arms stand near their path", off)
        if ended == FAULTED:
            checks.latched(case, rig)
            if kind.recovers:
                # Until what was wrong is over.
                rig.until(lambda: rig.now > 100.0 + _OVER + 0.3, 2.0 * _OVER)
                before = len(case.broken)
                checks.recovers(case, rig)
                result.recovered = len(case.broken) == before
        if not rig.server.motion:
            result.left = sum(rig.controller.queued)
            checks.never_run(case, rig)
        result.points = rig.controller.points
        case.violations(rig.violations())
        if not kind.full_disk:
            checks.whole_log(case, rig, fault=ended == FAULTED)
    if not case.broken:
        rig.log_path.unlink()


def _drive(
    rig: Rig,
    rng: np.random.Generator,
    number: int,
    strike: int,
    pending: dict[str, float],
    result: Cycle,
) -> str:
    """Go on to the end, changing the override, holding and resuming by chance; how it ended."""
    end = rig.now + _LONGEST
    last = number
    while rig.now < end:
        rig.step()
        if rig.state == controller_state.FAULT:
            return FAULTED
        if rig.state == controller_state.READY and rig.status.completed >= last:
            return COMPLETED
        if rig.controller.points >= strike:
            # At the beginning of a motion the points are not the whole lead ahead yet.
            running = (
                rig.state == controller_state.RUNNING and rig.now - rig.states[-1][0] > _LEAD_BUILT
            )
            if pending["sleep"] and running:
                rig.sleep(pending["sleep"])
                pending["sleep"] = 0.0
            if pending["dies"]:
                for link in list(rig.driver.links.values()):
                    link.close("the client dies")
                rig.sleep(0.5)
                pending["dies"] = 0.0
            if pending["disk"]:
                rig.disk.full, pending["disk"] = True, 0.0
        if rig.state == controller_state.HELD:
            if rng.uniform() < 0.05:
                last = rig.resume()
        elif rig.state == controller_state.RUNNING and rng.uniform() < 0.012:
            result.changes += 1
            if rng.uniform() < 0.3 and result.changes < 12 and not pending["sleep"]:
                rig.hold()
            else:
                rig.driver.set_override(float(rng.uniform(0.15, 1.0)))
    return f"{rig.state} after {_LONGEST:g} s"
