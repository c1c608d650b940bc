"""Faults G1 and G2: grippers that close on nothing, lose the cloth, or do not hear."""

import dataclasses as dc

import numpy as np

from tests.robustness.rig.fault import Case, Fault
from tests.robustness.rig.live import Execution, LiveController
from unwrinkle.flattening.state import RunStatus
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.simulation.controllers.server import ServerFault
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing import cells
from unwrinkle.testing.scripted_station import Script, depth_cell, run_loop, towel_capture

_RIDGE = Ridge((-0.02, -1.10), 1.25, 0.021, 0.0125, 0.30)
_TOWEL = Towel((_RIDGE,), (0.0, -1.10), thickness=0.004)
_MISSED = ("approach", "close", "open", "retreat")
_DONE = ("approach", "close", "pull", "open", "release")


def _looks(flat_from: int) -> Script:
    """A wrinkled towel that is flat from a look on."""

    def look(number: int) -> Capture:
        towel = _TOWEL if number < flat_from else dc.replace(_TOWEL, ridges=())
        return towel_capture(towel)

    return Script(look)


def _loses_cloth(case: Case) -> None:
    """G1: a gripper does not close, or loses the cloth, in the loop."""
    attempts = LoopSettings().grasp_attempts
    script = _looks(3)
    script.no_close[1] = (True, False)
    run = run_loop(script)
    case.expect(run.outcomes[0][0] == "missed", "the action is marked as missed", run.outcomes[0])
    case.reads(run.outcomes[0][1], "right gripper closed on nothing")
    case.expect(run.sent[:4] == _MISSED, "opened before the retreat, the way it came", run.sent)
    case.expect(run.sent[4:] == _DONE, "after another look it is tried again", run.sent[4:])

    script = _looks(99)
    script.no_close = {number: (True, True) for number in range(1, 99)}
    scenario = depth_cell().scenario
    rules = dc.replace(scenario.loop, arms="dual")
    run = run_loop(script, cell=load_cell(dc.replace(scenario, loop=rules)))
    misses = sum(outcome == "missed" for outcome, _ in run.outcomes)
    case.expect(misses == attempts, "the attempts are bounded", misses)
    case.expect(run.end.status == RunStatus.STOPPED, "then the loop stops", run.end.status)
    case.expect("pull" not in run.sent, "nothing is pulled without cloth", run.sent)
    case.expect(np.allclose(run.stands, run.start), "the arms are back where they began")
    case.reads(run.end.reason, "missed")

    script = _looks(3)
    script.lost_at = "pull"
    run = run_loop(script)
    case.expect(
        run.outcomes[0][0] not in ("done", ""),
        "cloth that slips out during the pull marks the action as failed",
        run.outcomes[0],
    )
    case.expect(run.end.head.number >= 2, "the cloth is looked at again")


def _not_heard(case: Case) -> None:
    """G2: a gripper's command is lost, in the loop."""
    script = _looks(99)
    script.deaf = frozenset(range(1, 9))
    run = run_loop(script)
    case.expect(run.end.status == RunStatus.FAULTED, "the fault latches", run.end.status)
    case.expect(
        run.sent in (("approach",), ("approach", "hold")),
        "no motion follows a stroke that was not answered",
        run.sent,
    )
    case.expect(run.duration < 30.0, "in bounded time", run.duration)
    case.reads(run.end.reason, "did not close", "not finished after")


def _executed(case: Case, name: str, *faults: ServerFault, holding: bool = True) -> str:
    """Execute a plan at the command line with grippers that fail; what the user reads."""
    folder = case.folder / name.replace(" ", "_")
    folder.mkdir()
    with LiveController(*faults, holding=holding) as live:
        site = live.site_file(folder, grippers={"timeout": 1.2})
        run = Execution.going(folder, site, "--speed", "0.5")
        code = run.end()
        case.expect(code == 4, f"{name}: it ends with exit code 4", f"{code}: {run.error}")
        case.expect(live.until(live.at_rest, 2.0), f"{name}: the arms rest")
        approach = cells.plan().segments[0].trajectory.positions[-1]
        off = float(np.abs(live.controller.positions - approach).max())
        case.expect(
            off < 1e-3 or np.abs(live.controller.positions - live.start).max() < 1e-3,
            f"{name}: nothing was pulled: they stand where they were to grip, or where they began",
            off,
        )
        case.expect(
            live.closed_outputs == (False, False),
            f"{name}: the grippers were opened again",
            live.closed_outputs,
        )
    records = read_run_log(run.log)
    case.expect(not records.cut, f"{name}: the log is whole")
    return run.error


def loses_cloth(case: Case) -> None:
    """G1: a gripper does not close, or loses the cloth."""
    _loses_cloth(case)
    case.reads(_executed(case, "closed on nothing", holding=False), "gripper closed on nothing")
    case.reads(_executed(case, "never closed", ServerFault("no_close")), "gripper")


def not_heard(case: Case) -> None:
    """G2: a gripper's command is lost."""
    _not_heard(case)
    case.reads(_executed(case, "outputs lost", ServerFault("lost_outputs")), "gripper")


FAULTS = (
    Fault(
        "G1",
        "a gripper does not close, or loses the cloth",
        "no cloth reported at a closing, at every closing, and from half the pull on",
        "action marked failed, cloth state re-sensed, bounded retries",
        loses_cloth,
    ),
    Fault(
        "G2",
        "a gripper's command is lost",
        "commands dropped in the whole loop, and on the wire",
        "time-out, open before retreat",
        not_heard,
    ),
)
