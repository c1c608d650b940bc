"""What every fault of the driver must leave behind.

Arms at rest together, a latched fault, a whole log, no limit broken.
"""

from collections.abc import Callable

import numpy as np

from tests.robustness.rig.driver_rig import Rig, swing
from tests.robustness.rig.fault import Case
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.hardware.run_log.reader import read_run_log

#: Both arms come to rest within so long of each other, s: a queue of increments is at most an
#: interpolation period apart.
TOGETHER = 0.15
#: A stop along the path leaves the path by no more than this, rad; the wire's float32 is part of
#: it.
ON_PATH = 2e-3
#: Servos that brake by themselves leave it by no more, rad.
NEAR_PATH = 0.05


def under_way(case: Case, rig: Rig, progress: float = 0.35) -> bool:
    """Connect, run the standard motion and be in the midst of it."""
    case.need(rig.connect(), "the driver gets ready", rig.status.reason or rig.state)
    rig.run()
    return case.expect(rig.moving(progress), "the motion is under way", rig.status.reason)


def faulted(case: Case, rig: Rig, *words: str, most: float = 4.0) -> None:
    """Go on until a fault latches, and read its reason.

    Raises:
        Different: there is none in time.
    """
    rig.until(lambda: rig.state == controller_state.FAULT, most)
    case.need(
        rig.state == controller_state.FAULT, "a fault latches", f"{rig.state} {rig.status.reason}"
    )
    case.reads(rig.status.reason, *words)


def stopped(
    case: Case,
    rig: Rig,
    *,
    near: float = ON_PATH,
    braking: bool = False,
    grace: float = 0.012,
    heard: bool = True,
    log: bool = True,
) -> None:
    """The arms rest together on their path, the fault stays, and the log tells all.

    Args:
        case, rig: of the row.
        near: most that an axis may stand off the path, rad.
        braking: the stop is a braking along the path, whose points are sent after the fault; else
            none may be.
        grace: s after the fault in which a point that was on its way may still arrive.
        heard: whether the controller still takes notice of what it is sent, if it is connected.
        log: whether there is a run log to read.
    """
    when = rig.entered(controller_state.FAULT) or rig.now
    case.expect(rig.settle(), "the arms rest", np.abs(rig.speed).max())
    apart = np.ptp(rig.rested())
    case.expect(apart <= TOGETHER, "both arms and the turn-table stop together", f"{apart:.3f} s")
    off = rig.off_path()
    case.expect(off <= near, f"they stand within {1e3 * near:g} mrad of their path", off)
    latched(case, rig)
    commands = [c for c in rig.commands() if c != Command.CHECK_MOTION_READY]
    if braking:
        case.expect(
            Command.STOP_MOTION not in commands, "no queue is emptied on the way", commands[-3:]
        )
        speeds = [np.abs(stream.velocities[-1]).max() for stream in rig.last_streams()]
        case.expect(max(speeds) == 0.0, "the points sent after it brake along the path", speeds)
    else:
        if heard and rig.server.motion:
            case.expect(
                commands[-1:] == [Command.STOP_MOTION] and commands.count(Command.STOP_MOTION) == 1,
                "the last that the controller received is one stop of all groups",
                commands[-3:],
            )
        after = rig.points_after(when + grace)
        case.expect(after == 0, "no point is sent after it", after)
    case.violations(rig.violations())
    unfit = list(rig.controller.audit.findings)
    case.expect(not unfit, "the controller was sent nothing that it should not be", unfit[:3])
    if log:
        whole_log(case, rig)


def latched(case: Case, rig: Rig) -> None:
    """Neither a resume nor a new trajectory moves anything before a reset."""
    reason = rig.status.reason
    points = rig.controller.points
    before = rig.controller.positions
    rig.resume()
    rig.step(10)
    kept = rig.trajectory
    number = rig.run(swing(rig.controller.positions))
    rig.trajectory = kept
    rig.step(30)
    case.expect(
        rig.state == controller_state.FAULT
        and rig.status.completed < number
        and rig.controller.points == points
        and np.array_equal(rig.controller.positions, before),
        "the fault latches: neither resume nor a new trajectory moves anything",
        rig.state,
    )
    case.expect(rig.status.reason != "", "and keeps its reason", reason)


def never_run(case: Case, rig: Rig) -> None:
    """Connecting again runs nothing that a dead motion connection left in the queues."""
    stood = rig.controller.positions
    queued = max(rig.controller.queued) > 0
    rig.leave()
    ready = rig.connect(most=2.0)
    case.expect(
        ready != queued,
        "a motion connection is made if and only if the queues are empty",
        rig.state,
    )
    rig.step(20)
    case.moved(np.abs(rig.controller.positions - stood).max())


def recovers(case: Case, rig: Rig) -> None:
    """After a reset a new trajectory runs, from where the robot stands and without a jump."""
    trace = len(rig.controller.trace)
    rig.driver.reset()
    ready = rig.until(lambda: rig.state == controller_state.READY, 3.0)
    case.need(ready, "a reset clears it", f"{rig.state} {rig.status.reason}")
    stands = rig.controller.positions
    number = rig.run(swing(stands, way=-0.5 * (rig.controller.positions + 0.1)))
    case.expect(
        rig.complete(number),
        "a new trajectory from where it stands runs to its end",
        f"{rig.state} {rig.status.reason}",
    )
    off = max(float(np.abs(s.positions[0] - stands[s.axes]).max()) for s in rig.last_streams())
    case.expect(off <= 1e-3, "its first point is where the robot stands", off)
    q = np.array([positions for _, positions, _ in list(rig.controller.trace)[trace:]])
    period = rig.controller.settings.period
    most = (np.abs(np.diff(q, axis=0)).max(axis=0) / (rig.limits.velocity * period)).max()
    case.expect(most <= 1.0, "no axis jumps", f"{most:.2f} of the velocity limit")


def completed(case: Case, rig: Rig, number: int, what: str) -> None:
    """A trajectory ran to its end in spite of it all, every point of it."""
    case.expect(rig.complete(number), what, f"{rig.state} {rig.status.reason}")
    assert rig.trajectory is not None
    end = rig.trajectory.positions[-1]
    rig.settle()
    off = float(np.abs(rig.controller.positions - end).max())
    case.expect(off < 1e-4, "the arms stand at its end", off)
    case.expect(rig.controller.underruns == 0, "the queues never ran out", rig.controller.underruns)
    case.violations(rig.violations())
    skipped = [s for s in rig.streams() if len(s.times) < 2]
    case.expect(not skipped, "every group took its points", len(skipped))


def whole_log(case: Case, rig: Rig, *, fault: bool = True) -> None:
    """Close everything and read the log.

    It tells what was sent, what was measured and why it ended.
    """
    reason = next((text for text in [rig.status.reason] if text), "")
    rig.close()
    records = read_run_log(rig.log_path)
    case.expect(not records.cut, "the log ends with a whole line")
    case.expect(len(records.measured.times) > 0, "the log has the feedback")
    sent = records.commanded.positions.astype(np.float32)
    missing = 0
    for stream in rig.streams():
        known = {row.tobytes() for row in np.ascontiguousarray(sent[:, stream.axes])}
        taken = np.ascontiguousarray(stream.positions.astype(np.float32))
        missing += sum(row.tobytes() not in known for row in taken)
    case.expect(missing == 0, "the log has every point that the controller took", missing)
    if fault:
        texts = [event.text for event in records.events if event.kind == "fault"]
        case.expect(bool(texts), "the log has the fault", [e.kind for e in records.events][-4:])
        case.expect(
            any(status.state == controller_state.FAULT for status in records.statuses),
            "and the state it led to",
            reason,
        )


def each(case: Case, kinds: dict[str, Callable[[], None]]) -> None:
    """Play several injections of one row; what differs is told with the injection's name."""
    for name, play in kinds.items():
        before = len(case.broken)
        play()
        case.broken[before:] = [f"{name}: {text}" for text in case.broken[before:]]
