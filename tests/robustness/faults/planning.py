"""Faults P1 to P6: planning that fails, plans that changed, and cells that are no longer as
they were.
"""

import dataclasses as dc

import numpy as np

from tests.robustness.rig.fault import Case, Fault
from unwrinkle.flattening.state import RunStatus
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError, NoVerifiedPlanError
from unwrinkle.models.robot import load_cell
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.planning.trajectory import SampledCubic
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing import cells
from unwrinkle.testing.scripted_station import LoopRun, Script, run_loop, towel_capture
from unwrinkle.testing.targets import flattening_task

#: Rounding of the cubics' own extremes at a sample period, of a limit.
_CUBICS = 0.01


def _far_towel(case: Case, y: float) -> LoopRun:
    """The closed loop with a wrinkled towel on a table that stands too far away."""
    scenario = cells.with_table(case.folder, y)
    scenario = dc.replace(
        scenario,
        garment_centre=[0.0, y],
        sensor=dc.replace(scenario.sensor, kind="depth"),
    )
    ridge = Ridge((0.0, y - 0.02), 0.0, 0.021, 0.0125, 0.25)
    towel = Towel((ridge,), (0.0, y - 0.02), side=0.40, thickness=0.004)

    def look(number: int) -> Capture:
        seen = towel if number == 1 else dc.replace(towel, ridges=())
        return towel_capture(seen, seed=case.seed + number)

    return run_loop(Script(look), cell=load_cell(scenario))


def infeasible(case: Case) -> None:
    """P1: no inverse kinematics for one arm, for both."""
    run = _far_towel(case, -1.6)
    refusals = run.end.finished.refusals if run.end.finished is not None else ()
    case.expect(
        [item.arms for item in refusals] == ["dual"],
        "the dual-arm motion is refused once and counted",
        [(item.arms, item.reason) for item in refusals],
    )
    case.reads(refusals[0].reason if refusals else "", "no dual-arm motion", "mm of reach")
    case.expect(
        run.sent == ("approach", "close", "pull", "open", "release"),
        "one arm does it instead",
        run.sent,
    )
    case.expect(run.end.status == RunStatus.FLAT, "and the loop ends flat", run.end.status)

    run = _far_towel(case, -2.6)
    arms = [item.arms for item in run.end.action.refusals]
    case.expect(
        arms == ["dual", "single"], "where neither can, both refusals are counted, one each", arms
    )
    case.expect(run.end.status == RunStatus.STOPPED, "then the loop stops", run.end.status)
    case.expect(run.sent == (), "nothing was sent", run.sent)
    case.expect(np.array_equal(run.stands, run.start), "the arms stand where they stood")
    case.reads(run.end.reason, "no motion for any", "dual", "single")


def nasty_paths(case: Case) -> None:
    """P2: near-zero motion, repeated points, reversals."""
    limits = cells.cell().limits
    full = PathLimits(limits.velocity, limits.acceleration, limits.jerk)
    line = np.linspace(0.0, 0.5, 24)[:, None] * np.ones(13)
    waits, returns, cusp = line.copy(), line.copy(), line.copy()
    waits[8:12] = line[8]
    returns[12:] = line[11::-1]
    cusp[12:, 6:] = cusp[12, 6:]
    nasty = {
        "a motion of 1e-7 rad": 1e-7 * line,
        "a motion of 1e-5 rad": 1e-5 * line,
        "repeated points": waits,
        "a reversal": returns,
        "axes that stop half way": cusp,
        "noise of 1e-6 rad on the way": line + 1e-6 * case.rng.standard_normal(line.shape),
    }
    for name, points in nasty.items():
        (timed,) = time_paths([JointPath.through(points)], [full])
        t, q, v = timed.sample(min(0.008, timed.duration / 20.0))
        found = SampledCubic(t, q, v).extremes()
        worst = max(
            (found.speed / limits.velocity).max(), (found.acceleration / limits.acceleration).max()
        )
        over = [f"{name}: {worst:.3f} of a limit"] if worst > 1.0 + _CUBICS else []
        case.violations(over)
        ends = np.abs(q[[0, -1]] - points[[0, -1]]).max()
        case.expect(
            np.isfinite(v).all() and ends < 1e-9, f"{name}: timed to its ends, at rest there", ends
        )
    for name, points in (("no length", 0.0 * line), ("no number", np.nan * line)):
        try:
            time_paths([JointPath.through(points)], [full])
        except (InputError, NoVerifiedPlanError) as error:
            case.expect(True, f"{name}: refused by name")
            case.reads(str(error))
        except ValueError as error:
            case.expect(False, f"{name}: refused by name", f"ValueError: {error}")
        else:
            case.expect(False, f"{name}: refused by name", "a timed path")
    # The whole planner from a start that leaves no way, or next to none, to its first pose.
    plan = cells.plan()
    mark = next(m for m in plan.segments[0].poses if m.name == "plan")
    pose = plan.segments[0].trajectory.interpolant()(mark.time)
    for off in (0.0, 1e-9, 1e-6):
        result = cells.planner().plan(flattening_task((0.0, -1.10), 0.2), start=pose + off)
        if result.plan is None:
            case.expect(result.failure is not None, "no plan without a named cause")
            continue
        verdict = verify(result.plan, cells.cell(), start=pose + off)
        case.expect(
            verdict.passed,
            "a start at the first pose itself: planned and verified",
            verdict.summary(),
        )


def impossible_limits(case: Case) -> None:
    """P3: impossible limits."""
    scenario = cells.with_jerk(case.folder, 0.0)
    try:
        load_cell(scenario)
    except InputError as error:
        case.reads(str(error), "limits.yaml", "not positive")
    else:
        case.expect(False, "limits that are not positive are refused", "a cell")
    limits = dc.replace(cells.cell().limits, jerk=np.zeros(13))
    try:
        time_line(np.zeros(13), np.ones(13), limits, 0.0, 0.008)
    except NoVerifiedPlanError as error:
        case.reads(str(error), "jerk-limited")
    else:
        case.expect(False, "ruckig's error is a named refusal", "a motion")
    slow = load_cell(cells.with_jerk(case.folder, 1e-10))
    try:
        result = FlatteningPlanner(slow).plan(flattening_task((0.0, -1.10), 0.2))
    except NoVerifiedPlanError as error:
        case.reads(str(error))
        return
    found = "" if result.plan is None else f"a plan of {result.plan.motion_time:.0f} s"
    if case.expect(result.plan is None, "a motion beyond the time budget is refused", found):
        case.need(result.failure is not None, "with a cause")
        assert result.failure is not None
        case.reads(result.failure.message, " s")


def bad_start(case: Case) -> None:
    """P4, the part of planning and verification.

    The preflight's part is with the executor's rows.
    """
    limits = cells.cell().limits
    outside = cells.home()
    outside[3] = limits.upper[3] + 0.01
    for name, start, words in (
        ("beyond a limit", outside, (cells.cell().robot.axes[3], "outside its limits", "jog")),
        ("in collision", colliding(case), ("too close to", "jog")),
    ):
        result = cells.planner().plan(flattening_task((0.0, -1.10), 0.2), start=start)
        case.expect(result.plan is None, f"{name}: no plan")
        case.reads("" if result.failure is None else result.failure.message, *words)
        verdict = verify(cells.plan(), cells.cell(), start=start)
        case.expect(
            "start" in {item.kind for item in verdict.violations},
            f"{name}: a plan from elsewhere is not verified",
            verdict.summary(),
        )


def _collides(posture: Array) -> bool:
    found = cells.planner().plan(flattening_task((0.0, -1.10), 0.2), start=posture)
    return found.failure is not None and "too close" in found.failure.message


def colliding(case: Case) -> Array:
    """A posture within the limits in which two bodies are too close to each other."""
    limits, rng = cells.cell().limits, case.rng
    for _ in range(200):
        posture = rng.uniform(limits.lower, limits.upper)
        if _collides(posture):
            return np.asarray(posture)
    raise AssertionError("no colliding posture found in 200")


def edited_plan(case: Case) -> None:
    """P5: plan edited after the preview."""
    plan = cells.plan()
    shown = plan.content_hash  # what the preview's page carries
    path = case.folder / "plan.npz"
    plan.save(path)
    data = path.read_bytes()
    rng, refused, same = case.rng, 0, 0
    for _ in range(60):
        spoiled = bytearray(data)
        spoiled[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(spoiled)
        try:
            read = FlatteningPlan.load(path)
        except InputError as error:
            refused += 1
            if refused == 1:
                case.reads(str(error), "plan.npz")
        else:
            # A bit that carries no content (a date in the archive, say).
            same += read.content_hash == shown
    case.expect(refused + same == 60, "no flipped bit changes what is read", (refused, same))
    case.expect(refused > 50, "nearly every one is refused", refused)

    positions = plan.segments[1].trajectory.positions.copy()
    positions[1:-1, 4] += 1e-9
    pull = plan.segments[1]
    edited = dc.replace(
        plan,
        segments=(
            plan.segments[0],
            dc.replace(pull, trajectory=dc.replace(pull.trajectory, positions=positions)),
            plan.segments[2],
        ),
    )
    edited.save(path)
    read = FlatteningPlan.load(path)
    case.expect(
        read.content_hash != shown, "an edit that is saved with care has another hash than the page"
    )
    verdict = verify(plan, cells.cell())
    case.expect(verdict.passed, "the plan as it was passes", verdict.summary())
    case.expect(
        verdict.plan_hash == shown != verify(edited, cells.cell()).plan_hash,
        "a verdict names the plan that it is of",
    )


def moved_table(case: Case) -> None:
    """P6: scene changed since planning."""
    plan = cells.plan()
    here = load_cell(cells.with_table(case.folder, -1.18))
    try:
        plan.check_made_for(here)
    except InputError as error:
        case.reads(str(error), "another model of the cell", "plan again")
    else:
        case.expect(False, "the plan is refused in the changed cell", "accepted")
    verdict = verify(plan, here)
    case.expect(not verdict.passed, "its verdict there is invalid", verdict.summary())
    case.expect(
        any(item.kind == "hash" for item in verdict.violations),
        "and names the cell as the cause",
        verdict.violations[:1],
    )
    anew = FlatteningPlanner(here).plan(flattening_task((0.0, -1.10), 0.2)).plan
    case.need(anew is not None, "planning anew gives a plan")
    assert anew is not None
    case.expect(verify(anew, here).passed, "which passes")
    case.expect(
        not verify(anew, cells.cell()).passed, "and is of no use where the table stood before"
    )


FAULTS = (
    Fault(
        "P1",
        "no inverse kinematics for one arm, for both",
        "the table 0.4 m and 1.4 m farther away in the whole loop",
        "documented fallback single-arm, then skip, then stop; reason counted",
        infeasible,
    ),
    Fault(
        "P2",
        "near-zero motion, repeated points, reversals",
        "eight nasty paths to the timing, and plans that start at their first pose",
        "retry ladder, then named error",
        nasty_paths,
    ),
    Fault(
        "P3",
        "impossible limits",
        "jerk limits of 0 and of 1e-10 of the catalogue's in a limits file",
        "plan refused",
        impossible_limits,
    ),
    Fault(
        "P5",
        "plan edited after the preview",
        "60 flipped bits, and an edit of 1 nrad that is saved with care",
        "hash mismatch, refuse",
        edited_plan,
    ),
    Fault(
        "P6",
        "scene changed since planning",
        "the working table 2 cm nearer in the directives",
        "verdict invalid, re-plan",
        moved_table,
    ),
)
