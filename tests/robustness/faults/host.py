"""Faults C1, C3, C4, P7, H1 and H2.

The host, its disk, a second owner, the operator's hands.
"""

import errno
import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np

from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import STEP, Disk, Rig
from tests.robustness.rig.fault import Case, Fault
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.server import ServerFault

POINTS = 45
_OWNER = """
import dataclasses, sys, time
from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.models.limits import load_limits
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.site import loopback_site
motion, state, io = map(int, sys.argv[1:])
ports = dict(motion_port=motion, state_port=state, io_port=io)
site = dataclasses.replace(loopback_site().controller, **ports)
driver = ControllerDriver(site, load_limits(models_dir() / "limits.yaml"), command="the first one")
driver.connect()
print("connected", flush=True)
sys.stdin.readline()
driver.close()
"""


def late_loop(case: Case) -> None:
    """C1: host clock jump, pauses, overrun."""

    def asleep(duration: float) -> Callable[[], None]:
        def play() -> None:
            with Rig(case.folder, name=f"asleep{duration:g}") as rig:
                checks.under_way(case, rig)
                rig.sleep(duration)
                before, when = rig.controller.points, rig.now
                rig.step(1)
                burst = rig.controller.points - before
                case.expect(burst <= 1, "no burst of late points", burst)
                checks.faulted(case, rig, "nothing is sent late")
                case.expect(rig.points_after(when + STEP) == 0, "nothing is sent late")
                checks.stopped(case, rig, near=checks.NEAR_PATH)

        return play

    def jump(by: float) -> Callable[[], None]:
        def play() -> None:
            with Rig(case.folder, name=f"jump{by:g}") as rig:
                checks.under_way(case, rig)
                before = rig.controller.points
                rig.late += by
                rig.step(4)
                burst = rig.controller.points - before
                case.expect(burst <= 4, "no burst of points", burst)
                rig.until(
                    lambda: (
                        rig.state == controller_state.FAULT or rig.status.completed >= rig.number
                    ),
                    6.0,
                )
                if rig.state == controller_state.FAULT:
                    case.reads(rig.status.reason)
                    checks.stopped(case, rig, near=checks.NEAR_PATH)
                else:
                    checks.completed(case, rig, rig.number, "it goes on along its path")

        return play

    def hiccups() -> None:
        with Rig(case.folder, name="hiccups") as rig:
            checks.under_way(case, rig, 0.2)
            for _ in range(4):
                rig.sleep(0.06)
                rig.step(15)
            late = rig.status.late
            checks.completed(case, rig, rig.number, "a pause shorter than the lead does no harm")
            case.expect(late >= 4, "late polls are counted and told", late)

    def many() -> None:
        with Rig(case.folder, site={"late_budget": 3}, name="many") as rig:
            checks.under_way(case, rig, 0.1)
            for _ in range(6):
                rig.sleep(0.056)
                rig.step(15)
            checks.faulted(case, rig, "polled late")
            checks.stopped(case, rig, braking=True)

    checks.each(
        case,
        {
            "asleep for 0.3 s": asleep(0.3),
            "asleep for 2 s": asleep(2.0),
            "the clock jumps by 5 s": jump(5.0),
            "the clock jumps back by 5 s": jump(-5.0),
            "pauses of 60 ms": hiccups,
            "more late polls than allowed": many,
        },
    )


def full_disk(case: Case) -> None:
    """C3: disk full."""
    full = os.strerror(errno.ENOSPC)
    with Rig(case.folder, disk=Disk(full=True), name="start") as rig:
        rig.connect()
        rig.run()
        rig.step(200)
        case.expect(
            rig.controller.points == 0 and np.array_equal(rig.controller.positions, rig.start),
            "a log that cannot be written at the start: motion is refused",
            rig.controller.points,
        )
        case.reads(rig.status.reason, "log", full)
    with Rig(case.folder, name="way") as rig:
        checks.under_way(case, rig)
        rig.disk.full = True
        checks.faulted(case, rig, "log", full)
        checks.stopped(case, rig, braking=True, log=False)
        rig.driver.reset()
        rig.step(10)
        case.expect(
            rig.state == controller_state.FAULT,
            "no reset clears it while the disk is full",
            rig.state,
        )
        case.reads(rig.status.reason, "not reset")
    records = read_run_log(rig.log_path)
    case.expect(
        not records.cut and len(records.commanded.times) > 0, "what was written until then is whole"
    )


def _owner(case: Case, ports: list[str]) -> "subprocess.Popen[str]":
    """A process that connects and says so; it ends with the next line that it is told."""
    return subprocess.Popen(
        [sys.executable, "-c", _OWNER, *ports],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=case.folder,
    )


def second_owner(case: Case) -> None:
    """C4: two executors for one robot."""
    with Rig(case.folder, name="owner") as rig:
        ports = [str(port) for port in rig.server.ports]
        first = _owner(case, ports)
        try:
            assert first.stdout is not None
            case.need(first.stdout.readline() == "connected\n", "a first process owns the robot")
            try:
                rig.driver.connect()
            except HardwareError as error:
                case.reads(str(error), str(first.pid), "the first one")
            else:
                case.expect(False, "a second one is refused", rig.state)
            rig.world()
            case.expect(
                len(rig.server.motion) <= 1 and rig.controller.points == 0,
                "it does not take over the connection",
            )
        finally:
            first.communicate("\n", timeout=20.0)
        for _ in range(5):
            rig.world()
        case.expect(rig.connect(), "once the first is gone, the second may", rig.status.reason)
        # A process that was killed leaves no lock behind.
        rig.driver.close()
        killed = _owner(case, ports)
        assert killed.stdout is not None
        killed.stdout.readline()
        killed.kill()
        killed.communicate()
        for _ in range(5):
            rig.world()
        rig.driver.connect()
        case.expect(True, "a killed owner leaves no lock behind")


def overridden(case: Case) -> None:
    """P7: speed override changed in motion."""
    with Rig(case.folder, name="override") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        rig.driver.set_override(0.1)
        number = rig.run()
        rig.moving(0.15)
        for value in (1.0, 0.3, 1.0):
            rig.driver.set_override(value)
            rig.step(60)
        for value in (1.5, -0.1, float("nan")):
            rig.driver.set_override(value)
            case.expect(rig.status.override == 1.0, f"an override of {value} is refused, unchanged")
        case.reads(rig.status.reason, "override", "refused")
        checks.completed(case, rig, number, "the motion runs to its end")
        off = max(_off_path(rig))
        case.expect(off < 1e-5, "every point sent lies on the path", off)
        checks.whole_log(case, rig, fault=False)


def _off_path(rig: Rig) -> list[float]:
    """Distance of the points that were sent from the trajectory's line, rad."""
    assert rig.trajectory is not None
    a, b = rig.trajectory.positions[[0, -1]]
    found = []
    for stream in rig.streams():
        way = (b - a)[stream.axes]
        share = (stream.positions - a[stream.axes]) @ way / (way @ way)
        found.append(float(np.abs(stream.positions - a[stream.axes] - np.outer(share, way)).max()))
    return found


def pressed(case: Case) -> None:
    """H1: e-stop pressed and released in motion."""
    with Rig(
        case.folder, ServerFault("e_stop_released", points=POINTS, value=0.5), name="e_stop"
    ) as rig:
        checks.under_way(case, rig, 0.2)
        old = rig.trajectory
        checks.faulted(case, rig, "emergency stop")
        rig.settle()
        # Released in the meantime; nothing may come of that.
        rig.step(250)
        case.expect(not rig.controller.pendant.e_stop, "the stop is released again")
        stands = rig.controller.positions
        checks.latched(case, rig)
        case.expect(rig.off_path() <= checks.NEAR_PATH, "the arms stand near their path")
        rig.driver.reset()
        rig.until(lambda: rig.state == controller_state.READY, 3.0)
        rig.run(old, "the old one")
        rig.until(lambda: bool(rig.status.reason), 3.0)
        case.expect(
            np.array_equal(rig.controller.positions, stands),
            "after the reset the old trajectory is refused: a new plan is needed",
            rig.status.reason,
        )
        case.reads(rig.status.reason, "refused", "plan from where it stands")
        rig.until(lambda: rig.state == controller_state.READY, 3.0)
        checks.recovers(case, rig)
        case.violations(rig.violations())
        checks.whole_log(case, rig)


def switched(case: Case) -> None:
    """H2: teach mode, remote off, idle and moving."""

    def idle(kind: str, *words: str) -> Callable[[], None]:
        def play() -> None:
            # From 0.5 s on the server's clock: after the driver is ready, before anything runs.
            with Rig(case.folder, ServerFault(kind, at=0.5), name=f"idle_{kind}") as rig:
                case.need(rig.connect(), "the driver gets ready", rig.status.reason)
                rig.step(200)
                robot = rig.status.robot
                case.need(robot is not None, "the robot's status is known")
                rig.run()
                rig.until(lambda: bool(rig.status.reason), 10.0)
                case.expect(
                    rig.controller.points == 0
                    and np.array_equal(rig.controller.positions, rig.start),
                    "idle: motion is refused",
                    rig.state,
                )
                case.reads(rig.status.reason, *words)

        return play

    def moving(kind: str, *words: str) -> Callable[[], None]:
        def play() -> None:
            with Rig(case.folder, ServerFault(kind, points=POINTS), name=f"moving_{kind}") as rig:
                checks.under_way(case, rig, 0.2)
                checks.faulted(case, rig, *words)
                checks.stopped(case, rig, near=checks.NEAR_PATH)

        return play

    checks.each(
        case,
        {
            "teach, idle": idle("teach", "teach"),
            "remote off, idle": idle("remote_off", "remote"),
            "e-stop, idle": idle("e_stop", "emergency stop"),
            "alarm, idle": idle("alarm", "alarm"),
            "teach, moving": moving("teach", "teach"),
            "remote off, moving": moving("remote_off", "remote"),
            "e-stop, moving": moving("e_stop", "emergency stop"),
            "servos off, moving": moving("servo_off", "servo"),
            "alarm, moving": moving("alarm", "alarm"),
            "hold on the pendant, moving": moving("hold", "hold"),
        },
    )


FAULTS = (
    Fault(
        "C1",
        "host clock jump, pauses, overrun",
        "polls missing for 60 ms to 2 s, and a clock that jumps by 5 s",
        "no command burst; path time scaled or fault",
        late_loop,
    ),
    Fault(
        "C3",
        "disk full",
        "writes to the run log that fail from the start, and under way",
        "motion refused at start, or safe end while running",
        full_disk,
    ),
    Fault(
        "C4",
        "two executors for one robot",
        "a second process, and one that was killed",
        "lock refuses, names the owner",
        second_owner,
    ),
    Fault(
        "P7",
        "speed override changed in motion",
        "10 to 100 to 30 to 100 %, and 150 %, -10 %, NaN",
        "jerk bound kept",
        overridden,
    ),
    Fault(
        "H1",
        "e-stop pressed and released in motion",
        "scripted status; the servos brake, the queues are empty",
        "latched; reset and new plan required; no jump (command = measured)",
        pressed,
    ),
    Fault(
        "H2",
        "teach mode, remote off, idle and moving",
        "scripted status, and servos off, an alarm, the pendant's hold besides",
        "state shown, motion refused or stopped",
        switched,
    ),
)
