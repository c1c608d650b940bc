"""One plan in three forms: simulated, through the drivers and TCP, and as the run log has it."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from unwrinkle.benchmarks._station_runs import StationRun, first_plan, run_on_station
from unwrinkle.benchmarks.report import Progress
from unwrinkle.flattening_run import FlatteningRun
from unwrinkle.flattening_setup import build_loop, simulated_cloth, with_choices
from unwrinkle.hardware.run_log import RunLog
from unwrinkle.hardware.run_log_reader import RunLogRecords, read_run_log
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Scenario, load_scenario
from unwrinkle.motion_check import check_motion
from unwrinkle.perception.head_file import nominal_calibration
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.run_records import MotionRecord, SegmentMark
from unwrinkle.simulation.wrinkle_makers import start_state
from unwrinkle.systems.loopback_station import build_loopback_station
from unwrinkle.systems.sim_station import build_sim_station

Array = NDArray[np.float64]

#: Lags of one form behind another that are looked for, s, in steps of this first.
_MOST_LAG, _STEP = 2.5, 0.02
#: When the simulation that is compared with itself begins, s; the others do at 0.2.
_LATER = 0.204


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Run the first plan of the default towel in each form; smaller pictures if quick."""
    scenario = with_choices(load_scenario(), scale=0.25 if quick else None)
    progress(0, 6, "plan")
    plan = first_plan(scenario, seed)
    runs: dict[str, StationRun] = {}
    checks: dict[str, dict[str, Any]] = {}
    records = None
    with tempfile.TemporaryDirectory() as folder:
        for done, form in enumerate(("sim", "loopback"), start=1):
            progress(done, 6, form)
            path = Path(folder) / f"{form}.jsonl"
            runs[form], cell = _executed(with_choices(scenario, station=form), seed, plan, path)
            checks[form] = _against_plan(runs[form], plan, cell)
        records = read_run_log(path)
        loopback = _differences(runs["sim"], runs["loopback"])
        progress(3, 6, "loopback in phase")
        phases = _phases(runs["sim"], loopback["lags"], scenario.station.cloth_step)
        in_phase, _ = _executed(
            with_choices(scenario, station="loopback"),
            seed,
            plan,
            path.with_stem("in-phase"),
            phases,
        )
    progress(4, 6, "sim later")
    late, _ = _executed(scenario, seed, plan, path, {"approach": (1.0, _LATER)})
    true = runs["sim"].cloth
    progress(5, 6, "closed loop")
    loop = None if quick else _closed_loop(with_choices(scenario, station="loopback"), seed)
    return {
        "seed": seed,
        "plan": plan.content_hash[:12],
        "axes": list(cell.robot.axes),
        "duration": plan.motion_time,
        "against_plan": checks,
        "loopback": loopback,
        "log": _log_differences(runs["sim"], runs["loopback"], records),
        "cloth": {
            "in_phase": _distances(true, in_phase.cloth),
            "loopback": _distances(true, runs["loopback"].cloth),
            "sim_later": _distances(true, late.cloth),
        },
        "closed_loop": loop,
        "held": bool(runs["sim"].holding and runs["loopback"].holding),
        "records": len(records.measured.times),
        "points": len(records.commanded.times),
    }


def table(results: dict[str, Any]) -> str:
    """Return the headlines and a row per joint."""
    sim, loopback = (results["against_plan"][form] for form in ("sim", "loopback"))
    worst = max(row["max"] for row in results["loopback"]["joints"])
    logged = max(row["max"] for row in results["log"]["joints"])
    cloth = results["cloth"]
    lines = [
        (
            f"Plan {results['plan']}, {results['duration']:.2f} s of motion: the first one of the default towel. `loopback`: the "
            "drivers over TCP and serial lines to the virtual devices, whose joints drive the same plant. `log`: what the "
            f"driver wrote down of it, {results['records']} sets of feedback and {results['points']} points."
        ),
        "",
        "| what | target | measured |",
        "|---|---|---|",
        f"| loopback against sim, any joint, after the lag | 0.5 mrad | {1e3 * worst:.3f} mrad |",
        f"| log against sim, any joint, after the lag | | {1e3 * logged:.3f} mrad |",
        f"| grippers' distance against the plan: sim | 3 mm | {1e3 * sim['grip_distance_error']:.3f} mm |",
        f"| grippers' distance against the plan: loopback | 3 mm | {1e3 * loopback['grip_distance_error']:.3f} mm |",
        f"| following error after lag: sim, loopback | | {1e3 * sim['error']:.3f}, {1e3 * loopback['error']:.3f} mrad |",
        f"| cloth in the end against sim, worst vertex (RMS): loopback, in phase with the cloth's clock | 2 mm | {_mm(cloth['in_phase'])} |",
        f"| as soon as each step is done | | {_mm(cloth['loopback'])} |",
        f"| for comparison: sim against itself, begun 4 ms later | | {_mm(cloth['sim_later'])} |",
        f"| limits or clearances broken: sim, loopback | 0 | {len(sim['violations'])}, {len(loopback['violations'])} |",
        *_loop_rows(results["closed_loop"]),
        "",
        "Lag of the segments behind the simulation's, from the command on (servo power, start of the job, the pause between "
        "trajectories included): "
        + ", ".join(f"{name} {lag:.3f} s" for name, lag in results["loopback"]["lags"].items())
        + ".",
        "",
        "| joint | loopback: max | RMS | log: max | RMS |",
        "|---|---|---|---|---|",
    ]
    for axis, a, b in zip(
        results["axes"], results["loopback"]["joints"], results["log"]["joints"], strict=True
    ):
        numbers = " | ".join(
            f"{1e3 * v:.4f} mrad" for v in (a["max"], a["rms"], b["max"], b["rms"])
        )
        lines.append(f"| {axis} | {numbers} |")
    return "\n".join(lines)


def _closed_loop(scenario: Scenario, seed: int) -> dict[str, Any]:
    """The default towel, flattened through the drivers."""
    clock = time.perf_counter()
    loop = build_loop(scenario, seed=seed)
    try:
        run = FlatteningRun(loop)
        ending = run.run()
        truth = run.station.truth() or {}
    finally:
        loop.close()
    seconds = time.perf_counter() - clock
    actions = ending.situation.memory.actions
    return {"status": ending.status, "actions": actions, "seconds": seconds, **truth}


def _loop_rows(loop: dict[str, Any] | None) -> list[str]:
    if loop is None:
        return []
    return [
        f"| closed loop through the drivers, the default towel: status, actions | flat | {loop['status']}, {loop['actions']} |",
        f"| its true height and coverage in the end | 5 mm, 98 % | {1e3 * loop['height']:.1f} mm, {loop['coverage']:.1%} |",
        f"| its wall clock | | {loop['seconds']:.0f} s |",
    ]


def _mm(distances: dict[str, float]) -> str:
    return f"{1e3 * distances['worst']:.3f} mm ({1e3 * distances['rms']:.3f} mm)"


def _distances(a: Array, b: Array) -> dict[str, float]:
    """Between two states (n, 3) of the cloth, m."""
    apart = np.linalg.norm(a - b, axis=1)
    return {"worst": float(apart.max()), "rms": float(np.sqrt(np.mean(apart**2)))}


def _phases(
    sim: StationRun, lags: dict[str, float], period: float
) -> dict[str, tuple[float, float]]:
    """When in the cloth's period each segment has to be commanded, so that it begins to move when it does in simulation."""
    step = 0.004  # of the drivers' and the controllers' clocks
    return {
        name: (period, round((begin - lags[name]) / step) * step % period)
        for name, (begin, _) in zip(sim.names, sim.spans, strict=True)
    }


def _executed(
    scenario: Scenario,
    seed: int,
    plan: FlatteningPlan,
    path: Path,
    phases: dict[str, tuple[float, float]] | None = None,
) -> tuple[StationRun, Cell]:
    """Run the plan on a station of its own."""
    cell = load_cell(scenario)
    head = nominal_calibration().stereo_head(cell.limits.head)
    cloth = simulated_cloth(cell)
    x, y = scenario.garment_centre
    state = start_state(cloth, scenario.station.garment.start, (x, y), seed)
    if scenario.station.form == "sim":
        station = build_sim_station(cell, cloth, state, head=head, seed=seed)
        return run_on_station(station, cloth, plan, phases), cell
    log = RunLog.create(path, {"plan": plan.content_hash, "station": scenario.station.form})
    virtual = build_loopback_station(cell, cloth, state, head=head, seed=seed, log=log)
    try:
        return run_on_station(virtual, cloth, plan, phases), cell
    finally:
        virtual.close()
        log.close()


def _against_plan(run: StationRun, plan: FlatteningPlan, cell: Cell) -> dict[str, Any]:
    motion = run.motion
    marks = tuple(
        SegmentMark(name, begin, end)
        for name, (begin, end) in zip(run.names, run.spans, strict=True)
    )
    record = MotionRecord(
        motion.times,
        motion.measured,
        motion.velocities,
        motion.reference,
        motion.openings,
        marks,
    )
    check = check_motion(record, plan, cell)
    assert check is not None
    return {
        "error": check.error_after_lag,
        "grip_distance_error": check.grip_distance_error,
        "violations": list(check.violations),
    }


def _differences(sim: StationRun, other: StationRun) -> dict[str, Any]:
    """Segment by segment, once the lag is taken out that leaves the least."""
    return _apart(sim, other, other.motion.times, other.motion.measured)


def _log_differences(sim: StationRun, other: StationRun, records: RunLogRecords) -> dict[str, Any]:
    """The same for the feedback that was logged."""
    return _apart(sim, other, records.measured.times, records.measured.positions)


def _apart(sim: StationRun, other: StationRun, times: Array, measured: Array) -> dict[str, Any]:
    """Compare what was measured (n, 13), rad, at times (n,), s, of the other station's clock."""
    lags, left = {}, []
    for name, span, (start, end) in zip(sim.names, sim.spans, other.spans, strict=True):
        inside = (times >= start) & (times <= end)
        lag, rest = _lag(sim, span, times[inside] - start, measured[inside])
        lags[name] = lag
        left.append(rest)
    rest = np.concatenate(left)
    joints = [
        {"max": float(np.abs(column).max()), "rms": float(np.sqrt(np.mean(column**2)))}
        for column in rest.T
    ]
    return {"lags": lags, "joints": joints}


def _lag(
    sim: StationRun, span: tuple[float, float], since: Array, measured: Array
) -> tuple[float, Array]:
    """The lag (s) behind the simulation's segment that leaves the least, and what it leaves, (n, 13) rad."""
    begin, end = span
    inside = (sim.motion.times >= begin) & (sim.motion.times <= end)
    own, unique = np.unique(sim.motion.times[inside] - begin, return_index=True)
    path = CubicSpline(own, sim.motion.measured[inside][unique])

    def left(lag: float) -> Array:  # the robot rests before and after a segment
        return np.asarray(measured - path(np.clip(since - lag, own[0], own[-1])))

    def worst(lag: float) -> float:
        return float(np.abs(left(lag)).max())

    best = float(min(np.arange(-_STEP, _MOST_LAG, _STEP), key=worst))
    bounds = (best - _STEP, best + _STEP)
    found = minimize_scalar(worst, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    lag = float(found.x) if found.fun < worst(best) else best
    return lag, left(lag)
