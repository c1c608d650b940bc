"""Faults F1 to F8: what the controller's own firmware does that nobody would expect of it.

Its source is public (ros-industrial/motoman, CloPeMa/motoman); the virtual controller behaves as it
does.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.robustness.rig import checks
from tests.robustness.rig.driver_rig import WAY, Rig, swing
from tests.robustness.rig.driver_thread import polled_in_thread
from tests.robustness.rig.fault import Case, Fault
from tests.robustness.rig.increments import run_increments
from tests.robustness.rig.live import Execution, LiveController
from unwrinkle.hardware import controller_state
from unwrinkle.hardware.controller.clear_queue import clear_queue
from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.process import DriverProcess
from unwrinkle.hardware.controller_state import DriverStatus
from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.models.errors import HardwareError
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ServerFault
from unwrinkle.testing import cells

#: Moments of a full-speed plan at which the driver's process is killed.
KILLS = 50
#: Moments at which the motion connection dies, on the fake clock.
DEATHS = 20
#: A way whose axis S needs more than half of its speed in 0.8 s, rad.
FAST = np.zeros(13)
FAST[1] = 0.75
#: A lag is told this well, s.
LAG_ERROR = 0.010
#: Path error at full speed that is allowed, rad.
PATH_ERROR = 0.7e-3


def queue_left(case: Case) -> None:
    """F1: motion left in the controller's queues."""
    checks.each(
        case,
        {
            "the motion connection dies": lambda: _deaths(case),
            "the host dies, its connections stay open": lambda: _host_crash(case),
            "the driver gives up": lambda: _abandoned(case),
            "the driver's process is killed": lambda: kills(case, KILLS),
        },
    )


def _deaths(case: Case) -> None:
    rng, left = case.rng, 0
    for number in range(DEATHS):
        profile = ("groups", "ex")[number % 2]
        site = {"profile": profile, "connect_timeout": 0.6}
        with Rig(case.folder, site=site, name=f"death{number}") as rig:
            checks.under_way(case, rig, float(rng.uniform(0.1, 0.8)))
            for link in list(rig.driver.links.values()):
                link.close("killed")
            rig.sleep(0.5)
            left += min(rig.controller.queued) > 0
            stood = rig.controller.positions
            for _ in range(2):
                rig.driver.close()
                rig.connect()
                case.expect(
                    rig.state == controller_state.FAULT and not rig.server.motion,
                    "no motion connection is made while something is in the queues",
                    rig.state,
                )
                rig.run(swing(stood, 0.2 * WAY))
                rig.step(50)
            case.moved(np.abs(rig.controller.positions - stood).max())
            case.reads(rig.status.reason, "motion left in its queues", "HOLD", "--clear-queue")
    case.expect(left == DEATHS, f"{DEATHS} of {DEATHS} deaths leave increments behind", left)


def _host_crash(case: Case) -> None:
    with Rig(case.folder, name="crash") as rig:
        checks.under_way(case, rig, 0.3)
        old = dict(rig.driver.links)
        rig.driver.links.clear()  # nobody polls them, nobody closes them
        rig.sleep(1.0)
        stood = rig.controller.positions
        case.expect(max(rig.controller.queued) == 0, "the queues run out", rig.controller.queued)
        rig.driver.close()
        ready = rig.connect()
        case.expect(ready, "then the next connection is safe, and made", rig.status.reason)
        case.moved(np.abs(rig.controller.positions - stood).max())
        for link in old.values():
            link.close()


def _abandoned(case: Case) -> None:
    with LiveController() as live:
        site = _site(live)
        driver = _Fails(site, cells.cell().limits, lock_directory=case.folder)
        with polled_in_thread(driver) as thread:
            thread.wait(lambda status: status.state == controller_state.READY, 5.0)
            thread.run(1, swing(live.start))
            thread.wait(lambda status: status.state == controller_state.FAULT, 5.0)
        case.expect(
            Command.STOP_MOTION in live.commands(),
            "it sends a stop before it parts",
            live.commands(),
        )
        case.expect(live.until(live.at_rest, 2.0), "the arms rest")
        stood = live.controller.positions
        case.expect(max(live.controller.queued) == 0, "nothing is left in the queues")
        code, text = _site_check(case.folder, live)
        case.expect(code == 0, "the next connection is safe", text)
        case.moved(np.abs(live.controller.positions - stood).max())


class _Fails(ControllerDriver):
    """A driver whose loop fails for good once the controller has taken some points, even in its
    fault.
    """

    def poll(self, now: float) -> None:
        """As ever, until then."""
        super().poll(now)
        if self.status.points >= 40:
            raise RuntimeError("out of memory")

    def fail(self, text: str) -> None:
        """Fail as well."""
        raise RuntimeError(text)


def kills(case: Case, count: int) -> None:
    """Kill the driver's process so often, each time at another moment.

    Then check the site and try a dry run and a run.
    """
    rng, left = case.rng, 0
    for number in range(count):
        folder = case.folder / f"kill{number}"
        folder.mkdir()
        with LiveController() as live:
            site = _site(live)
            moment = float(rng.uniform(0.4, cells.plan().motion_time - 0.3))
            _run_and_kill(case, live, site, moment)
            time.sleep(0.2)
            case.need(live.until(live.at_rest, 5.0), "the axes brake and rest")
            stood = live.controller.positions
            queued = max(live.controller.queued) > 0
            left += queued
            code, text = _site_check(folder, live)
            case.expect(not queued or code == 4, "site check fails", code)
            if queued:
                case.reads(text, "motion left in its queues", "HOLD", "--clear-queue")
            _try(case, live, folder, ())
            _try(case, live, folder, ("--go", "--yes", cells.plan().content_hash[:12]))
            case.moved(np.abs(live.controller.positions - stood).max())
            if queued:
                cleared = clear_queue(site)
                case.expect(
                    cleared.needed and max(live.controller.queued) == 0,
                    "a stop as the first bytes empties the queues",
                )
    case.expect(left > 0, "killed drivers leave increments behind", left)


def _run_and_kill(case: Case, live: LiveController, site: Any, moment: float) -> None:
    """Run the plan's segments at full speed and kill the driver's process once so much of its
    motion has gone by, s.
    """
    with DriverProcess(site, cells.cell().limits) as driver:
        case.need(
            driver.wait(lambda s: s.state == controller_state.READY, 5.0), "the driver gets ready"
        )
        for number, segment in enumerate(cells.plan().segments, start=1):
            driver.run(number, segment.trajectory, segment.name)
            duration = segment.trajectory.duration
            if moment < duration:
                driver.wait(_reached(moment), 20.0)
                assert driver.pid is not None
                os.kill(driver.pid, signal.SIGKILL)
                case.reads(driver.status.reason, "process has ended", "HOLD")
                return
            driver.wait(_completed(number), 20.0)
            moment -= duration


def _reached(moment: float) -> Callable[[DriverStatus], bool]:
    return lambda status: status.state == controller_state.RUNNING and status.progress >= moment


def _completed(number: int) -> Callable[[DriverStatus], bool]:
    return lambda status: status.completed >= number or bool(status.reason)


def _try(case: Case, live: LiveController, folder: Path, options: tuple[str, ...]) -> None:
    """Try to execute the plan; it has to be refused."""
    inner = folder / ("go" if options else "dry")
    inner.mkdir()
    run = Execution(inner, live.site_file(inner, controller={"connect_timeout": 0.6}), *options)
    code = run.end()
    case.expect(code == 4, "dry run and execution are refused, exit code 4", f"{code}: {run.error}")
    if max(live.controller.queued) > 0:  # what the other rows say differs from moment to moment
        first = run.error.partition("; robot: ")[0]
        case.reads(first, "motion left in its queues", "HOLD")


def _site_check(folder: Path, live: LiveController) -> tuple[int, str]:
    """`unwrinkle site check` in a process of its own.

    Its exit code, and what it says of the motion port.
    """
    command = [sys.executable, "-m", "unwrinkle", "site", "check", str(live.site_file(folder))]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=folder, timeout=60.0
    )
    text = " ".join(done.stdout.split())
    _, _, rest = text.partition("controller motion")
    return done.returncode, rest.partition("controller I/O")[0]


def truncated(case: Case) -> None:
    """F2: times cut to whole milliseconds."""
    for profile in ("groups", "ex"):
        for period in (0.004, 0.008):
            found = run_increments(case.folder, profile, period)
            case.increments.append(found)
            label = f"{profile}, {1e3 * period:g} ms"
            case.expect(
                found.completed and found.underruns == 0,
                "a plan at full speed runs to its end, the queues never run out",
                label,
            )
            worst = max(found.velocity, found.acceleration, found.jerk)
            case.expect(
                worst <= 1.0,
                "velocity, acceleration and jerk of the increments are within the plan's limits",
                f"{label}: {worst:.4f}",
            )
            case.expect(
                found.path_error <= PATH_ERROR,
                f"the path is kept within {1e3 * PATH_ERROR:g} mrad",
                f"{label}: {found.path_error:.2g}",
            )
            case.expect(
                not found.audit,
                "every point is sent as a whole millisecond, one message at a time",
                found.audit,
            )


def delayed(case: Case) -> None:
    """F3: delay between command and feedback."""
    for delay in (0.15, 0.25):
        for speed in (0.2, 1.0):
            settings = VirtualControllerSettings(delay=delay)
            name = f"delay{1e3 * delay:.0f}-{speed:g}"
            with Rig(case.folder, settings=settings, name=name, axes_lag=0.0) as rig:
                case.need(rig.connect(), "the driver gets ready", rig.status.reason)
                rig.driver.set_override(speed)
                for segment in cells.plan().segments:
                    number = rig.run(segment.trajectory, segment.name)
                    case.expect(
                        rig.complete(number, 60.0),
                        "the plan runs to its end",
                        f"{name}: {rig.status.reason}",
                    )
                told = rig.status.lag
                case.expect(
                    abs(told - delay) <= LAG_ERROR,
                    f"the lag is told within {1e3 * LAG_ERROR:g} ms",
                    f"{name}: {1e3 * told:.0f} ms",
                )
                case.violations(rig.violations())
    settings = VirtualControllerSettings(delay=0.4)
    with Rig(case.folder, settings=settings, name="too late", axes_lag=0.0) as rig:
        checks.under_way(case, rig, 0.0)
        checks.faulted(case, rig, "a lag of 4", "ms would fit", "controller.latency")


def governed(case: Case) -> None:
    """F4: speed governor."""
    settings = VirtualControllerSettings(speed_cap=0.4)
    with Rig(case.folder, site={"speed_cap": 0.4}, settings=settings, name="known") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        fast = swing(rig.start, FAST, 0.8)
        rig.run(fast)
        rig.until(lambda: bool(rig.status.reason), 3.0)
        case.reads(rig.status.reason, "refused", "speed governor", "controller.speed_cap 0.4")
        case.expect(
            rig.controller.points == 0 and np.array_equal(rig.controller.positions, rig.start),
            "a motion above the cap is refused before anything moves",
            rig.controller.points,
        )
        rig.driver.set_override(0.7)
        number = rig.run(fast)
        checks.completed(case, rig, number, "below the cap it runs")
    with Rig(case.folder, settings=settings, name="unknown") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        rig.run(swing(rig.start, FAST, 0.8))
        checks.faulted(case, rig, "a speed is above its axis' limit")
        case.expect(rig.settle(), "the arms rest", np.abs(rig.speed).max())
        case.expect(Command.STOP_MOTION in rig.commands(), "all groups are stopped", rig.commands())
        case.expect(rig.off_path() <= checks.NEAR_PATH, "near their path", rig.off_path())


def still_group(case: Case) -> None:
    """F5: a group that the firmware does not move."""
    moved = ("r1", "r2")
    settings = VirtualControllerSettings(moved=moved)
    with Rig(
        case.folder, site={"groups_moved": list(moved)}, settings=settings, name="known"
    ) as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        rig.run()
        rig.until(lambda: bool(rig.status.reason), 3.0)
        case.reads(rig.status.reason, "refused", "does not move", "turntable: fixed")
        case.expect(rig.controller.points == 0, "a motion that needs it is refused before")
        still = WAY.copy()
        still[0] = 0.0
        number = rig.run(swing(rig.start, still))
        checks.completed(case, rig, number, "a motion of the arms alone runs")
    with Rig(case.folder, settings=settings, name="unknown") as rig:
        checks.under_way(case, rig, 0.0)
        checks.faulted(case, rig, "ext_axis is", "off its path")
        case.expect(rig.settle(), "the arms rest", np.abs(rig.speed).max())
        case.expect(Command.STOP_MOTION in rig.commands(), "all groups are stopped", rig.commands())
        case.violations(rig.violations())
        off = abs(float(rig.controller.positions[0] - rig.start[0]))
        case.expect(off == 0.0, "the turn-table stood still all the time", off)


def off_the_start(case: Case) -> None:
    """F6: start off by less than a milliradian."""
    off = np.zeros(13)
    off[1] = 0.5e-3
    for name, site, words in (
        ("ours", {}, ("0.50 mrad off on r1_s", "at most 0.30 mrad")),
        ("theirs", {"start_tolerance": 1e-3, "start_pulses": 100.0}, ("commanded to stand",)),
    ):
        with Rig(case.folder, site=site, name=name) as rig:
            case.need(rig.connect(), "the driver gets ready", rig.status.reason)
            rig.run(swing(rig.start + off))
            rig.step(500)
            case.reads(rig.status.reason, *words)
            case.expect(
                np.array_equal(rig.controller.positions, rig.start), "nothing moves", rig.state
            )
    off[1] = 0.25e-3
    with Rig(case.folder, name="near") as rig:
        case.need(rig.connect(), "the driver gets ready", rig.status.reason)
        number = rig.run(swing(rig.start + off))
        checks.completed(case, rig, number, "a start within 30 pulses runs")


def without_io(case: Case) -> None:
    """F7: a controller of 2013, without an I/O port."""
    settings = VirtualControllerSettings(firmware="2013", accepts="groups", period=0.008)
    with Rig(case.folder, settings=settings, needs_io=False, name="old") as rig:
        rig.server.stop_listening("io")
        case.need(rig.connect(), "without an I/O port the driver gets ready", rig.status.reason)
        rig.driver.set_override(0.5)
        number = rig.run()
        checks.completed(case, rig, number, "and runs a motion to its end")
        try:
            rig.driver.write_output(10010, 1)
        except HardwareError as error:
            case.reads(str(error), "no I/O connection")
        else:
            case.expect(False, "an output is refused")
    with Rig(case.folder, settings=settings, name="needed") as rig:
        rig.server.stop_listening("io")
        try:
            rig.connect()
        except HardwareError as error:
            case.reads(str(error), f":{rig.site.io_port}", "io server")
        else:
            case.expect(False, "where grippers need it, the port is missed", rig.state)


def pieces(case: Case) -> None:
    """F8: messages put together or cut on their way."""
    for firmware in ("1.9.12", "2013"):
        settings = VirtualControllerSettings(firmware=firmware, accepts="groups")

        def together(settings: VirtualControllerSettings = settings) -> None:
            fault = ServerFault("coalesce", value=0.004)
            name = f"together-{settings.firmware}"
            with Rig(case.folder, fault, settings=settings, step=0.002, name=name) as rig:
                case.need(rig.connect(), "the driver gets ready", rig.status.reason)
                rig.driver.set_override(0.5)
                number = rig.run(swing(rig.start, 0.5 * WAY))
                checks.completed(
                    case, rig, number, "a peer that reads late gets one message a read"
                )
                case.expect(not rig.server.rejected, "none is lost", list(rig.server.rejected)[:3])
                rig.leave()
                tail = rig.commands()[-2:]
                case.expect(
                    tail == [Command.STOP_TRAJ_MODE, Command.DISCONNECT]
                    and not rig.controller.pendant.trajectory_mode,
                    "leaving is carried out, message by message",
                    tail,
                )

        def cut(settings: VirtualControllerSettings = settings) -> None:
            fault = ServerFault("cut", points=45, until=4.0, value=60.0)
            name = f"cut-{settings.firmware}"
            with Rig(case.folder, fault, settings=settings, name=name) as rig:
                checks.under_way(case, rig, 0.2)
                checks.faulted(case, rig)
                case.expect(rig.settle(), "the arms rest")
                off = rig.off_path()
                case.expect(off <= checks.NEAR_PATH, "near their path", off)
                case.violations(rig.violations())

        checks.each(case, {f"together, {firmware}": together, f"cut, {firmware}": cut})


def _site(live: LiveController) -> Any:
    """The live controller's site, with a short deadline."""
    site = live.site.controller
    site.motion_port, site.state_port, site.io_port = live.server.ports
    site.connect_timeout = 0.6
    return site


FAULTS = (
    Fault(
        "F1",
        "motion left in the controller's queues",
        f"the motion connection dead at {DEATHS} moments, the host dead, a driver that gives up, "
        f"the driver's process killed at {KILLS} moments of a full-speed plan",
        "0 rad moved by site check, dry run, execute; the user reads why; "
        "a confirmed stop empties the queues",
        queue_left,
    ),
    Fault(
        "F2",
        "times cut to whole milliseconds",
        "a full-speed plan, clocks of 4 and 8 ms, both profiles",
        "increments within the plan's limits and on its path; the queues never run out",
        truncated,
    ),
    Fault(
        "F3",
        "delay between command and feedback",
        "150 and 250 ms at 0.2 and 1.0 of the speed; 400 ms",
        "runs to the end, the lag told within 10 ms; beyond the latency a fault that names the lag",
        delayed,
    ),
    Fault(
        "F4",
        "speed governor",
        "points above 0.4 of an axis' speed are refused",
        "refused before the motion where the site says so; else a stop in motion",
        governed,
    ),
    Fault(
        "F5",
        "a group that the firmware does not move",
        "points of the turn-table are taken, and never run",
        "refused before the motion where the site says so; else off its path, stopped",
        still_group,
    ),
    Fault(
        "F6",
        "start off by less than a milliradian",
        "0.5 mrad on S, with our tolerance and with the controller's; 0.25 mrad",
        "refused with axis and distance, nothing moves; within 30 pulses it runs",
        off_the_start,
    ),
    Fault(
        "F7",
        "a controller of 2013, without an I/O port",
        "nobody listens on the I/O port; one message a read, 8 ms",
        "runs where no gripper needs it; else named",
        without_io,
    ),
    Fault(
        "F8",
        "messages put together or cut on their way",
        "a peer that reads 4 ms late, and one that reads in pieces; firmware of 1.9.12 and 2013",
        "one message a read; a cut one ends in a stop",
        pieces,
    ),
)
