"""One plan in three forms: simulated, through the drivers and TCP, and as the run log has it."""

import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from benchmarks.parity.results import (
    AgainstPlan,
    BothAgainstPlan,
    ClosedLoop,
    ClothDistance,
    ClothDistances,
    Differences,
    JointDifference,
    ParityResult,
    Stopping,
)
from benchmarks.parity.station_runs import Setting, StationRun, first_plan, run_on_station
from unwrinkle.closed_loop.executed_motion import MeasuredSegment, check_execution
from unwrinkle.flattening.state import SupervisorSettings
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.hardware.streaming.path_clock import PathClock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.models.site import loopback_site
from unwrinkle.perception.stereo.compile_cache import ensure_compiled
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verifier import cell_model
from unwrinkle.simulation.cloth.measures import coverage, largest_height
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings

#: Lags of one form behind another that are looked for, s, in steps of this first.
_MOST_LAG, _STEP = 2.5, 0.02
#: When the simulation that is compared with itself begins, s; the others do at 0.2.
_LATER = 0.204
#: Holds are tried all over the plan, so far apart at full speed, s.
_HOLDS = 0.1


def run(*, quick: bool, seed: int, progress: Progress) -> ParityResult:
    """Run the first plan of the default towel in each form.

    Smaller pictures and no closed loop if quick.
    """
    scenario = load_scenario()
    if quick:
        scenario.sensor.scale = 0.25
    ensure_compiled()
    setting = Setting.of(scenario, seed)
    parts = 6
    progress(0, parts, "plan")
    plan = first_plan(setting)
    progress(1, parts, "sim")
    with setting.station("sim") as station:
        sim = run_on_station(station, setting.cloth, plan)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.jsonl"
        progress(2, parts, "loopback")
        loopback = _through_drivers(setting, plan, path)
        records = read_run_log(path)
        differences = _differences(sim, loopback)
        progress(3, parts, "loopback in phase")
        phases = _phases(sim, differences.lags, scenario.station.cloth_step)
        in_phase = _through_drivers(setting, plan, path.with_stem("in-phase"), phases)
    progress(4, parts, "sim later")
    with setting.station("sim") as station:
        late = run_on_station(station, setting.cloth, plan, {"approach": (1.0, _LATER)})
    progress(5, parts, "closed loop")
    return ParityResult(
        seed=seed,
        plan=plan.content_hash[:12],
        axes=tuple(setting.cell.robot.axes),
        duration=plan.motion_time,
        against_plan=BothAgainstPlan(
            sim=_against_plan(sim, plan, setting.cell, dict.fromkeys(sim.names, 0.0)),
            loopback=_against_plan(loopback, plan, setting.cell, differences.lags),
        ),
        loopback=differences,
        log=_apart(sim, loopback, records.measured.times, records.measured.positions),
        cloth=ClothDistances(
            in_phase=_distances(sim.cloth, in_phase.cloth),
            loopback=_distances(sim.cloth, loopback.cloth),
            sim_later=_distances(sim.cloth, late.cloth),
        ),
        stops={f"{rate:g}": _stops(plan, setting.cell, rate) for rate in (1.0, 0.2)},
        stopping={f"{rate:g}": _stopping(plan, setting.cell, rate) for rate in (1.0, 0.2)},
        closed_loop=None if quick else _closed_loop(setting),
        held=bool(sim.holding and loopback.holding),
        records=len(records.measured.times),
        points=len(records.commanded.times),
    )


def table(results: ParityResult) -> str:
    """Return the headlines and a row per joint."""
    sim, loopback = results.against_plan.sim, results.against_plan.loopback
    worst = max(row.max for row in results.loopback.joints)
    logged = max(row.max for row in results.log.joints)
    cloth = results.cloth
    lines = [
        (
            f"Plan {results.plan}, {results.duration:.2f} s of motion: the first one of the default towel. `loopback`: the "
            "drivers over TCP and serial lines to the virtual devices, whose joints drive the same plant. `log`: what the "
            f"driver wrote down of it, {results.records} sets of feedback and {results.points} points."
        ),
        "",
        line("what", "target", "measured"),
        rule(3),
        line(
            "loopback against sim, any joint, after the lag",
            "0.5 mrad",
            f"{1e3 * worst:.3f} mrad",
        ),
        line("log against sim, any joint, after the lag", "", f"{1e3 * logged:.3f} mrad"),
        line(
            "grippers' distance against the plan: sim",
            "3 mm",
            f"{1e3 * sim.grip_distance_error:.3f} mm",
        ),
        line(
            "grippers' distance against the plan: loopback",
            "3 mm",
            f"{1e3 * loopback.grip_distance_error:.3f} mm",
        ),
        line(
            "following error after lag: sim, loopback",
            "",
            f"{1e3 * sim.error:.3f}, {1e3 * loopback.error:.3f} mrad",
        ),
        line(
            "cloth in the end against sim, worst vertex (RMS): loopback, in phase with the cloth's clock",
            "2 mm",
            f"{_mm(cloth.in_phase)}",
        ),
        line("as soon as each step is done", "", f"{_mm(cloth.loopback)}"),
        line("for comparison: sim against itself, begun 4 ms later", "", f"{_mm(cloth.sim_later)}"),
        line(
            "limits or clearances broken: sim, loopback",
            "0",
            f"{len(sim.violations)}, {len(loopback.violations)}",
        ),
        *(
            line(
                f"braking along the path at {float(rate):.0%} of the planned speed, median (worst of {len(times)}); the lead of {loopback_site().controller.lead:g} s comes before it",
                "",
                f"{np.median(times):.2f} s ({max(times):.2f} s)",
            )
            for rate, times in results.stops.items()
        ),
        *_stopping_rows(results.stopping),
        *_loop_rows(results.closed_loop),
        "",
        "Lag of the segments behind the simulation's, from the command on (servo power, start of the job, the pause between "
        "trajectories included): "
        + ", ".join(f"{name} {lag:.3f} s" for name, lag in results.loopback.lags.items())
        + ".",
        "",
        line("joint", "loopback: max", "RMS", "log: max", "RMS"),
        rule(5),
    ]
    for axis, a, b in zip(results.axes, results.loopback.joints, results.log.joints, strict=True):
        numbers = " | ".join(f"{1e3 * v:.4f} mrad" for v in (a.max, a.rms, b.max, b.rms))
        lines.append(line(f"{axis}", f"{numbers}"))
    return "\n".join(lines)


def _stops(plan: FlatteningPlan, cell: Cell, rate: float) -> tuple[float, ...]:
    """Times from the last point before a hold to rest, s, for holds all over a plan."""
    limits, times = StreamLimits.of(cell.limits), []
    for segment in plan.segments:
        for begin in np.arange(0.1, segment.trajectory.duration / rate, _HOLDS / rate):
            clock = PathClock(segment.trajectory, limits, rate=rate)
            before = clock.next_until(float(begin))[-1].time
            clock.set_rate(0.0)
            points = clock.next_until(np.inf)
            if points:
                times.append(points[-1].time - before)
    return tuple(times)


def _stopping(plan: FlatteningPlan, cell: Cell, rate: float) -> Stopping:
    """Time and way of the tips from a stop to rest, for stops all over a plan: s and m.

    A hold comes after the points that are on their way (`lead`), brakes along the path, and is seen
    by the axes a delay later. A stop of all groups empties the queues; the axes run what is under
    way in the delay, then brake by themselves.
    """
    limits, site, settings = (
        StreamLimits.of(cell.limits),
        loopback_site().controller,
        VirtualControllerSettings(),
    )
    found: dict[str, list[float]] = {
        name: [] for name in ("hold_time", "hold_way", "stop_time", "stop_way")
    }
    for segment in plan.segments:
        trajectory = segment.trajectory
        curve = trajectory.interpolant()
        speed = curve.derivative()
        for now in np.arange(0.1, trajectory.duration / rate, _HOLDS / rate):
            clock = PathClock(trajectory, limits, rate=rate)
            sent = clock.next_until(float(now) + site.lead)[-1]
            clock.set_rate(0.0)
            last = ([sent, *clock.next_until(np.inf)])[-1]
            seen = max(float(now) - settings.delay, 0.0) * rate  # where the axes are
            found["hold_time"].append(last.time - float(now) + settings.delay)
            found["hold_way"].append(_tips_way(cell, curve(np.linspace(seen, last.s, 24))))
            s = min(float(now) * rate, trajectory.duration)
            v = speed(s) * rate
            end = curve(s) + v * np.abs(v) / (2.0 * settings.braking)
            found["stop_time"].append(settings.delay + float(np.abs(v).max()) / settings.braking)
            found["stop_way"].append(
                _tips_way(cell, np.vstack([curve(np.linspace(seen, s, 24)), end]))
            )
    return Stopping(**{name: tuple(values) for name, values in found.items()})


def _tips_way(cell: Cell, positions: Array) -> float:
    """Length of the longer of both tips' ways through postures (n, 13), m."""
    openings = np.full((len(positions), 2), cell.scenario.gripper.opening)
    _, X_WT = cell_model(cell).frames(np.hstack([positions, openings]))
    steps = np.linalg.norm(np.diff(X_WT[:, :, :3, 3], axis=0), axis=2)
    return float(steps.sum(axis=0).max())


def _stopping_rows(stopping: dict[str, Stopping]) -> list[str]:
    delay = VirtualControllerSettings().delay
    rows = []
    for rate, found in stopping.items():
        for name, what in (
            (
                "hold",
                f"hold: lead of {loopback_site().controller.lead:g} s, braking along the path",
            ),
            ("stop", "stop of all groups: queues emptied, servos brake by 10 rad/s² (assumed)"),
        ):
            times, ways = getattr(found, f"{name}_time"), getattr(found, f"{name}_way")
            rows.append(
                line(
                    f"{what}, then {delay:g} s of delay (assumed), at {float(rate):.0%} of the planned speed: from the order to rest, median (worst of {len(times)}); way of the tips meanwhile",
                    "",
                    f"{np.median(times):.2f} s ({max(times):.2f} s); {1e3 * np.median(ways):.0f} mm ({1e3 * max(ways):.0f} mm), simulated",
                )
            )
    return rows


def _closed_loop(setting: Setting) -> ClosedLoop:
    """The default towel, flattened through the drivers."""
    clock = time.perf_counter()
    with setting.station("loopback") as station:
        *_, (now, state) = setting.situations(station, SupervisorSettings.of_site(loopback_site()))
    return ClosedLoop(
        status=now.status,
        actions=now.policy_state.actions,
        seconds=time.perf_counter() - clock,
        height=float(largest_height(setting.cloth, state)),
        coverage=float(coverage(setting.cloth, state)),
    )


def _loop_rows(loop: ClosedLoop | None) -> list[str]:
    if loop is None:
        return []
    return [
        line(
            "closed loop through the drivers, the default towel: status, actions",
            "flat",
            f"{loop.status}, {loop.actions}",
        ),
        line(
            "its true height and coverage in the end",
            "5 mm, 98 %",
            f"{1e3 * loop.height:.1f} mm, {loop.coverage:.1%}",
        ),
        line("its wall clock", "", f"{loop.seconds:.0f} s"),
    ]


def _mm(distances: ClothDistance) -> str:
    return f"{1e3 * distances.worst:.3f} mm ({1e3 * distances.rms:.3f} mm)"


def _distances(a: Array, b: Array) -> ClothDistance:
    """Between two states (n, 3) of the cloth, m."""
    apart = np.linalg.norm(a - b, axis=1)
    return ClothDistance(worst=float(apart.max()), rms=float(np.sqrt(np.mean(apart**2))))


def _phases(
    sim: StationRun, lags: dict[str, float], period: float
) -> dict[str, tuple[float, float]]:
    """When in the cloth's period each segment has to be commanded, so that it begins to move when
    it does in simulation.
    """
    step = 0.004  # of the drivers' and the controllers' clocks
    return {
        name: (period, round((begin - lags[name]) / step) * step % period)
        for name, (begin, _) in zip(sim.names, sim.spans, strict=True)
    }


def _through_drivers(
    setting: Setting,
    plan: FlatteningPlan,
    path: Path,
    phases: dict[str, tuple[float, float]] | None = None,
) -> StationRun:
    """Run the plan on a loopback station, with a log."""
    header = {"plan": plan.content_hash, "station": "loopback"}
    with RunLog.create(path, header) as log, setting.station("loopback", log) as station:
        return run_on_station(station, setting.cloth, plan, phases)


def _against_plan(
    run: StationRun, plan: FlatteningPlan, cell: Cell, lags: dict[str, float]
) -> AgainstPlan:
    """Compare a run with the plan; `lags` are from the command to the motion, s."""
    motion, measured = run.motion, []
    for segment, (begin, end) in zip(plan.segments, run.spans, strict=True):
        begin += max(lags[segment.name], 0.0)
        inside = (motion.times >= begin) & (motion.times <= end)
        inside[1:] &= np.diff(motion.times) > 0.0
        times = motion.times[inside] - begin
        since = np.clip(times, 0.0, segment.trajectory.duration)
        measured.append(
            MeasuredSegment(
                segment.name,
                times,
                motion.measured[inside],
                motion.velocities[inside],
                segment.trajectory.interpolant()(since),
                motion.openings[inside],
            )
        )
    check = check_execution(plan, cell, measured)
    return AgainstPlan(
        error=check.error_after_lag,
        grip_distance_error=check.grip_distance_error,
        violations=tuple(check.violations),
    )


def _differences(sim: StationRun, other: StationRun) -> Differences:
    """Segment by segment, once the lag is taken out that leaves the least."""
    return _apart(sim, other, other.motion.times, other.motion.measured)


def _apart(sim: StationRun, other: StationRun, times: Array, measured: Array) -> Differences:
    """Compare what was measured (n, 13), rad, at times (n,), s, of the other station's clock."""
    lags, left = {}, []
    for name, span, (start, end) in zip(sim.names, sim.spans, other.spans, strict=True):
        inside = (times >= start) & (times <= end)
        lag, rest = _lag(sim, span, times[inside] - start, measured[inside])
        lags[name] = lag
        left.append(rest)
    rest = np.concatenate(left)
    joints = [
        JointDifference(max=float(np.abs(column).max()), rms=float(np.sqrt(np.mean(column**2))))
        for column in rest.T
    ]
    return Differences(lags, tuple(joints))


def _lag(
    sim: StationRun, span: tuple[float, float], since: Array, measured: Array
) -> tuple[float, Array]:
    """The lag (s) behind the simulation's segment that leaves the least, and what it leaves, (n,
    13) rad.
    """
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
