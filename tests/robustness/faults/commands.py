"""Faults C2, P4 and V6, through the command line.

What an operator starts, reads and is stopped from.
"""

import datetime
import signal
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.robustness.faults import planning
from tests.robustness.rig.driver_rig import swing
from tests.robustness.rig.driver_thread import polled_in_thread
from tests.robustness.rig.fault import Case, Fault
from tests.robustness.rig.live import Execution, LiveController
from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller_state import FAULT, READY
from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.testing import cells


def _folder(case: Case, name: str) -> Path:
    folder = case.folder / name
    folder.mkdir()
    return folder


def signalled(case: Case) -> None:
    """C2: SIGINT, SIGTERM, an exception in a callback."""
    rng = case.rng
    for number in (signal.SIGINT, signal.SIGTERM):
        name = signal.Signals(number).name
        folder = _folder(case, name)
        with LiveController() as live:
            # Half the speed: this machine may be busy with other things.
            run = Execution.going(folder, live.site_file(folder), "--speed", "0.5")
            points = int(rng.integers(20, 90))
            case.expect(run.reached(live, points), f"{name}: the motion is under way", points)
            run.process.send_signal(number)
            code = run.end()
            case.expect(code not in (0, None), f"{name}: a non-zero exit", code)
            case.expect(live.until(live.at_rest, 2.0), f"{name}: the arms rest")
            commands = live.commands()
            case.expect(
                Command.STOP_MOTION not in commands
                and commands[-2:] == [Command.STOP_TRAJ_MODE, Command.DISCONNECT],
                f"{name}: a hold along the path, then a clean disconnect",
                commands[-4:],
            )
            case.expect(live.until(live.disconnected, 2.0), f"{name}: disconnected")
            case.reads(run.out.strip().splitlines()[-1] if run.out.strip() else run.error)
            records = read_run_log(run.log)
            case.expect(
                not records.cut and len(records.commanded.times) > 0,
                f"{name}: the log is whole",
            )
            held = [e.kind for e in records.events]
            case.expect(
                "held" in held or "hold" in held, f"{name}: the log has the hold", held[-6:]
            )
    _broken_callback(case)


class _Breaks(ControllerDriver):
    """A driver in whose loop something raises."""

    polls = 0

    def poll(self, now: float) -> None:
        """As ever, until the controller took some points; then raise once."""
        super().poll(now)
        if self.status.points >= 30 and not self.polls:
            self.polls = 1
            raise RuntimeError("a callback has failed")


def _broken_callback(case: Case) -> None:
    with LiveController() as live:
        motion, state, io = live.server.ports
        site = live.site.controller
        site.motion_port, site.state_port, site.io_port = motion, state, io
        log = RunLog.create(case.folder / "callback.jsonl", {"what": "fault row"})
        driver = _Breaks(site, cells.cell().limits, log=log, lock_directory=case.folder)
        with log, polled_in_thread(driver) as thread:
            thread.wait(lambda status: status.state == READY, 5.0)
            thread.run(1, swing(live.start))
            thread.wait(lambda status: status.state == FAULT, 5.0)
            status = thread.status
            case.expect(status.state == FAULT, "an exception in the loop latches a fault", status)
            case.reads(status.reason, "a callback has failed")
            case.expect(live.until(live.at_rest, 3.0), "the arms rest")
        case.expect(live.until(live.disconnected, 2.0), "then it is disconnected")
        records = read_run_log(log.path)
        case.expect(
            any(event.kind == "fault" for event in records.events), "the log has the exception"
        )


def bad_posture(case: Case) -> None:
    """P4: start in collision or out of limits."""
    planning.bad_start(case)
    limits = cells.cell().limits
    outside = cells.home()
    outside[3] = limits.upper[3] + 0.003
    for name, start, words in (
        (
            "outside",
            outside,
            (cells.cell().robot.axes[3], "its limit", "jog the robot back", "deg"),
        ),
        ("colliding", planning.colliding(case), ("jog", "pendant")),
    ):
        folder = _folder(case, name)
        with LiveController(start=start) as live:
            run = Execution.going(folder, live.site_file(folder))
            code = run.end()
            case.expect(code == 4, f"{name}: refused, exit code 4", code)
            case.reads(run.error, "posture", *words)
            case.expect(
                live.motion_messages() == 0 and np.array_equal(live.controller.positions, start),
                f"{name}: nothing is sent, nothing moves by itself",
                live.motion_messages(),
            )


def calibrations(case: Case) -> None:
    """V6: calibration missing, stale, of large residual."""
    shipped = yaml.safe_load((models_dir() / "heads" / "clopema.yaml").read_text(encoding="utf-8"))
    today = datetime.date.today()

    def made(**changes: Any) -> dict[str, Any]:
        good = {**shipped, "date": today.isoformat(), "valid_days": 180, "row_residual": 0.1}
        for eye in ("left", "right"):
            good[eye] = {**good[eye], "views": 20, "residual": changes.get("residual", 0.2)}
        return {**good, **{k: v for k, v in changes.items() if k != "residual"}}

    old = (today - datetime.timedelta(days=400)).isoformat()
    cases: tuple[tuple[str, dict[str, Any] | None, bool, tuple[str, ...]], ...] = (
        ("missing", None, False, ("calibration", "unwrinkle calibrate")),
        ("stale", made(date=old), False, ("400 days old", "at most 180")),
        ("large residual", made(residual=3.0), False, ("residual is 3.00 pixels", "at most 0.5")),
        ("virtual", None, True, ()),
        ("good", made(), False, ()),
    )
    with LiveController() as live:
        for name, calibration, virtual, words in cases:
            folder = _folder(case, name.replace(" ", "_"))
            file = folder / "head.yaml"
            if calibration is not None:
                file.write_text(yaml.safe_dump(calibration), encoding="utf-8")
            site = live.site_file(
                folder, virtual=virtual, calibration="" if calibration is None else file.name
            )
            run = Execution(folder, site)
            code = run.end()
            if words:
                case.expect(code == 4, f"{name}: hardware is refused, exit code 4", code)
                case.reads(run.error, "calibration", *words)
            else:
                case.expect(code == 0, f"{name}: allowed", run.error)
            if virtual:
                banner = next((line for line in run.out.splitlines() if "VIRTUAL" in line), "")
                case.reads(banner, "virtual equipment", "nominal calibration")
        case.expect(live.motion_messages() == 0, "nothing was sent", live.motion_messages())


FAULTS = (
    Fault(
        "C2",
        "SIGINT, SIGTERM, an exception in a callback",
        "signals to `unwrinkle execute` at a random point of the motion; "
        "a driver's loop that raises",
        "hold, disconnect, non-zero exit, log intact",
        signalled,
    ),
    Fault(
        "P4",
        "start in collision or out of limits",
        "planner, verification and `unwrinkle execute` from such postures",
        "refuse, suggest escape move, never auto-move",
        bad_posture,
    ),
    Fault(
        "V6",
        "calibration missing, stale, of large residual",
        "calibration files of a site that is not virtual, and of one that is",
        "refuse hardware mode, allow simulation with a banner",
        calibrations,
    ),
)
