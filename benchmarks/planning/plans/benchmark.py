"""Dual-arm planning on a fixed, seeded set of targets.

Success, reasons, times, margins, verdicts.
"""

import dataclasses as dc
import time
from collections import Counter
from itertools import pairwise

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.planning.plans.baselines import drake_baseline, rrt_baseline
from benchmarks.planning.plans.page import plans_table
from benchmarks.planning.plans.results import (
    GroupedFigures,
    PlanFigures,
    PlannedTask,
    PlansResult,
    SiteFigures,
    Spread95,
)
from benchmarks.planning.plans.straight_lines import line_deviation, random_lines
from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Smoothing
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan, GarmentSurface
from unwrinkle.planning.search.failure import off_table
from unwrinkle.planning.search.planner import Approve, FlatteningPlanner, PlanResult
from unwrinkle.planning.timing.sampling import sent_ratios
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.testing.targets import Task, flattening_task, tasks
from unwrinkle.testing.toppra_bound import jerk_free_line_time, jerk_free_time

#: Fraction of the catalogue speed that the Glasgow robot was run at.
SITE_SPEED = 0.2


def run(*, quick: bool, seed: int, progress: Progress) -> PlansResult:
    """Plan and verify every task, at catalogue speed and at the site's, with the turn-table fixed,
    and with jerk bounded by ruckig; then the baselines.

    Targets with a grasp or put-down point beside the table are refused by design, counted, and left
    out of the fractions.
    """
    cell = load_cell()
    everything = tasks(seed, quick=quick)
    todo = [task for task in everything if off_table(task.target, cell) is None]
    total = 4 * len(todo) + 3
    rows = _run_all(cell, todo, progress, 0, total, "plans")
    slow = _run_all(cell.with_speed(SITE_SPEED), todo, progress, len(todo), total, "site speed")
    options = dc.replace(cell.scenario.planner, turntable="fixed")
    fixed = load_cell(dc.replace(cell.scenario, planner=options))
    still = _run_all(fixed, todo, progress, 2 * len(todo), total, "turn-table fixed")
    timing = dc.replace(cell.scenario.timing, smoothing=Smoothing.RUCKIG.value)
    by_ruckig = load_cell(dc.replace(cell.scenario, timing=timing))
    smoothed = _run_all(by_ruckig, todo, progress, 3 * len(todo), total, "ruckig")
    progress(total - 3, total, "random lines")
    lines = random_lines(cell, seed, 100 if quick else 400)
    # The same few whether or not a target is left out.
    few = [todo.index(task) for task in everything[:: 2 if quick else 6] if task in todo]
    targets = [todo[i].target for i in few]
    progress(total - 2, total, "Drake's IK")
    drake = drake_baseline(cell, targets)
    progress(total - 1, total, "RRT-Connect")
    still_figures = _grouped(still)
    return PlansResult(
        **vars(_grouped(rows)),
        off_table=len(everything) - len(todo),
        site_speed=SiteFigures(**vars(_summary(slow)), speed=SITE_SPEED),
        turntable_fixed=still_figures,
        dual_arm_success_turntable_fixed=still_figures.dual_arm_success,
        smoothing_ruckig=_summary(smoothed),
        random_lines=lines,
        line_deviation_max=max(
            *(line.deviation_max for line in lines),
            *(row.line_deviation for row in rows + slow + still + smoothed if row.planned),
        ),
        drake_inverse_kinematics=drake,
        ompl_rrt_connect=rrt_baseline(cell, targets),
        same_tasks=_summary([rows[i] for i in few]),
    )


def _grouped(rows: list[PlannedTask]) -> GroupedFigures:
    """Compute the figures over all tasks, and by their groups."""
    forward, lateral, wide = (
        _summary([row for row in rows if row.group == group])
        for group in ("forward", "lateral", "wide")
    )
    return GroupedFigures(**vars(_summary(rows)), forward=forward, lateral=lateral, wide=wide)


def table(results: PlansResult) -> str:
    """The results as Markdown."""
    return plans_table(results)


def _run_all(
    cell: Cell, todo: list[Task], progress: Progress, done: int, total: int, stage: str
) -> list[PlannedTask]:
    planner = _CpuTimedPlanner(cell)
    warm = flattening_task((0.0, -1.1), 0.0)
    planner.plan(warm)
    rows = []
    for i, task in enumerate(todo):
        progress(done + i, total, stage)
        rows.append(_measure(planner, cell, task))
    return rows


class _CpuTimedPlanner(FlatteningPlanner):
    """Planner that measures its CPU time, which other jobs on the machine affect less than the time
    on the clock.

    Attributes:
        cpu: of the last plan, without the approval's, s.
    """

    cpu = 0.0

    def plan(
        self,
        target: FlatteningTarget,
        *,
        start: Array | None = None,
        garment: GarmentSurface | None = None,
        arms: str = "any",
        approve: Approve | None = None,
    ) -> PlanResult:
        """Plan as `FlatteningPlanner.plan`, and keep the CPU time."""
        asked = 0.0

        def timed(plan: FlatteningPlan) -> str:
            nonlocal asked
            begin = time.process_time()
            refusal = "" if approve is None else approve(plan)
            asked += time.process_time() - begin
            return refusal

        begin = time.process_time()
        result = super().plan(target, start=start, garment=garment, arms=arms, approve=timed)
        self.cpu = time.process_time() - begin - asked
        return result


def _measure(planner: _CpuTimedPlanner, cell: Cell, task: Task) -> PlannedTask:
    clock = time.perf_counter()
    found = plan_verified(planner, cell, task.target)
    elapsed, result = time.perf_counter() - clock, found.result
    row = PlannedTask(
        group=task.group,
        dual=result.plan is not None and result.plan.dual,
        planned=result.plan is not None,
        cause=None if result.failure is None else result.failure.cause,
        message=None if result.failure is None else result.failure.message,
        search=result.timings.search,
        transit=result.timings.transit,
        timing=result.timings.timing,
        planning=result.timings.total,
        planning_cpu=planner.cpu,
        transit_kinds=tuple(result.timings.transit_kinds),
        violations=tuple(v.violations[0].message for v in found.refused),
    )
    if result.plan is None or found.verdict is None:
        return row
    curved, lines = optimum(result, cell.limits)
    samples = [segment.trajectory for segment in result.plan.segments]
    ratios = [sent_ratios(t.times, t.positions, t.velocities, cell.limits) for t in samples]
    velocity, acceleration, jerk = np.max(ratios, axis=0).tolist()
    row = dc.replace(
        row,
        # All of what is not planning is verification, that of refused plans included.
        verification=elapsed - result.timings.total,
        motion=result.plan.motion_time,
        ratio=result.plan.motion_time / (curved + lines),
        curved_ratio=sum(piece.duration for piece in result.pieces) / curved,
        line_deviation=line_deviation(result),
        velocity_ratio=velocity,
        acceleration_ratio=acceleration,
        jerk_ratio=jerk,
    )
    return _with_margins(row, found.verdict)


def optimum(result: PlanResult, limits: Limits) -> tuple[float, float]:
    """Least times without a jerk limit of a plan's paths, with the same stops.

    Curved pieces (toppra) and straight lines, s.
    """
    curved = sum(
        jerk_free_time(piece.path, limits, limits.tip_speed_holding if i == 1 else None)
        for i, piece in enumerate(result.pieces)
    )
    lines = sum(
        jerk_free_line_time(a, b, limits)
        for way in result.transits
        for a, b in pairwise(way.points)
    )
    return curved, lines


def _with_margins(row: PlannedTask, verdict: Verdict) -> PlannedTask:
    smallest = verdict.smallest
    near: dict[str, float] = {}
    for pair in verdict.clearances:
        if pair.distance is not None:
            near[pair.kind] = min(near.get(pair.kind, np.inf), pair.distance)
    # The verdict is about the samples as they are sent.
    velocity, acceleration, jerk = (
        float(verdict.check(name).value or 0.0) for name in ("velocity", "acceleration", "jerk")
    )
    return dc.replace(
        row,
        passed=verdict.passed,
        velocity_ratio_sent=velocity,
        acceleration_ratio_sent=acceleration,
        jerk_ratio_sent=jerk,
        clearance=None if smallest is None else smallest.distance,
        clearance_pair=None if smallest is None else " and ".join(smallest.bodies),
        clearances=near,
    )


def _summary(rows: list[PlannedTask]) -> PlanFigures:
    """Compute the figures over a set of tasks."""
    planned = [row for row in rows if row.planned]

    def spread(key: str, among: list[PlannedTask]) -> Spread95:
        values = [getattr(row, key) for row in among]
        return Spread95(
            float(np.median(values)), float(np.percentile(values, 95)), float(np.max(values))
        )

    def worst(key: str) -> float:
        return max(float(getattr(row, key)) for row in planned)

    planning, motion, ratio, curved = (
        spread("planning", rows),
        spread("motion", planned),
        spread("ratio", planned),
        spread("curved_ratio", planned),
    )
    near = [row for row in planned if row.clearance is not None]
    nearest = min(near, key=lambda row: row.clearance or 0.0) if near else None
    kinds = sorted({kind for row in planned for kind in row.clearances})
    return PlanFigures(
        tasks=len(rows),
        dual_arm_success=float(np.mean([row.dual for row in rows])),
        single_arm_rescues=sum(row.planned and not row.dual for row in rows),
        failures=tuple((row.cause, row.message) for row in rows if row.cause is not None),
        planning_time_median=planning.median,
        planning_time_p95=planning.p95,
        planning_time_max=planning.max,
        planning_time=planning,
        planning_cpu_time=spread("planning_cpu", rows),
        search_time=spread("search", rows),
        transit_time=spread("transit", rows),
        timing_time=spread("timing", planned),
        verification_time=spread("verification", planned),
        motion_time_median=motion.median,
        motion_time_max=motion.max,
        motion_time_ratio_median=ratio.median,
        motion_time_ratio_max=ratio.max,
        curved_time_ratio_median=curved.median,
        curved_time_ratio_max=curved.max,
        worst_velocity_ratio=worst("velocity_ratio"),
        worst_acceleration_ratio=worst("acceleration_ratio"),
        worst_jerk_ratio=worst("jerk_ratio"),
        worst_velocity_ratio_sent=worst("velocity_ratio_sent"),
        worst_acceleration_ratio_sent=worst("acceleration_ratio_sent"),
        worst_jerk_ratio_sent=worst("jerk_ratio_sent"),
        smallest_clearance=None if nearest is None else nearest.clearance,
        smallest_clearance_pair=None if nearest is None else nearest.clearance_pair,
        clearances={
            kind: min(row.clearances.get(kind, np.inf) for row in planned) for kind in kinds
        },
        verdicts_passed_fraction=float(np.mean([row.passed for row in planned])),
        refused=tuple(row.violations for row in rows if row.violations),
        transit_kinds=dict(Counter(kind for row in planned for kind in row.transit_kinds)),
    )
