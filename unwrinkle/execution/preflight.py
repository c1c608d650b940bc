"""Check everything that motion requires before it starts.

One row per check, and the verdict on the plan.

No check moves the robot, and none corrects anything silently: a failure is reported with what to
try.
"""

import datetime
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from unwrinkle.execution.finished_runs import FinishedRuns
from unwrinkle.execution.posture import check_posture, escape
from unwrinkle.hardware.controller_state import FAULT, OFFLINE, READY, DriverStatus, JointFeedback
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.site.preflight_checks import (
    check_governor,
    check_groups,
    check_log,
    check_margins,
    check_speed,
    check_tips,
    governed_speed,
    most_speed,
    tip_speed,
)
from unwrinkle.systems.station.preconditions import check_calibration

#: Maximum share of the planned speed in a plan's first run at a site under commissioning.
FIRST_RUN_SPEED = 0.1
VIRTUAL_BANNER = "VIRTUAL EQUIPMENT: the nominal calibration is used instead of a measured one"
COMMISSIONING_BANNER = (
    "COMMISSIONING: tips at most 0.25 m/s, doubled clearances, dead-man key, first run at 10 %"
)


@dataclass(frozen=True)
class PreflightCheck:
    """Result of one check.

    Attributes:
        name: one or two words.
        passed: whether the check passed.
        text: what was found; for a failure also by how much, and what to try.
    """

    name: str
    passed: bool
    text: str


@dataclass(frozen=True)
class Preflight:
    """Results of all checks.

    Attributes:
        checks: results in order.
        verdict: verdict of the verification; None if the plan is for another cell.
        speed: share of the planned speed that was checked.
        most_speed: maximum share of the planned speed in this run.
        banner: warning for the operator; may be empty.
    """

    checks: tuple[PreflightCheck, ...]
    verdict: Verdict | None
    speed: float
    most_speed: float = 1.0
    banner: str = ""

    @property
    def passed(self) -> bool:
        """Return whether motion may start."""
        return all(check.passed for check in self.checks)

    @property
    def failures(self) -> tuple[PreflightCheck, ...]:
        """Return the checks that failed."""
        return tuple(check for check in self.checks if not check.passed)

    def check(self, name: str) -> PreflightCheck:
        """Return the check of a name.

        Raises:
            KeyError: there is no such check.
        """
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)

    def summary(self) -> str:
        """Return one sentence on the checks."""
        if self.passed:
            return "all preflight checks passed"
        return "motion refused: " + "; ".join(f"{c.name}: {c.text}" for c in self.failures)


class GripperState(Protocol):
    """Part of the grippers' report that is checked."""

    @property
    def closed(self) -> tuple[bool, bool]:
        """Return whether the right and the left gripper are closed."""
        ...

    @property
    def reason(self) -> str:
        """Return why the grippers do not answer or work; empty if they do."""
        ...


def chosen_speed(
    site: Site, plan: FlatteningPlan, requested: float | None, finished: FinishedRuns
) -> float:
    """Return the share of the planned speed to execute at.

    It is the requested one, else the site's, reduced in a first run under commissioning.
    """
    if requested is not None:
        return requested
    first = finished.count(site.name, plan.content_hash) == 0
    return min(site.speed, FIRST_RUN_SPEED) if site.commissioning and first else site.speed


def preflight(
    plan: FlatteningPlan,
    cell: Cell,
    site: Site,
    feedback: JointFeedback | None,
    status: DriverStatus | None,
    now: float,
    *,
    speed: float | None = None,
    grippers: GripperState | None = None,
    log: Path | None = None,
    finished: FinishedRuns | None = None,
    today: datetime.date | None = None,
) -> Preflight:
    """Check everything that the execution of a plan requires.

    Args:
        plan: plan to be executed.
        cell: robot and cell.
        site: devices and their settings.
        feedback: last feedback of the robot; None if there is none.
        status: status of the driver; None if there is none.
        now: time of the driver's clock, s.
        speed: share of the planned speed; the site's if left out.
        grippers: report of the grippers; None if they could not be asked.
        log: file of the run log; None for a dry run without one.
        finished: record of finished runs; the user's own if left out.
        today: date for the calibration's age; today if left out.

    Returns:
        The results; a plan that may not be executed is a result, not an exception.
    """
    finished = FinishedRuns() if finished is None else finished
    day = datetime.date.today() if today is None else today
    used = chosen_speed(site, plan, speed, finished)
    rows = _CheckList()
    identity = rows.ask("plan", lambda: _check_plan(plan, cell))
    rows.ask("controller", lambda: _check_driver(status))
    rows.ask("robot", lambda: _check_robot(status))
    fresh = rows.ask("feedback", lambda: _check_feedback(site, feedback, now))
    verdict: Verdict | None = None
    most = 1.0
    positions = feedback.positions if fresh and feedback is not None else None
    if positions is not None and not _in_motion(status):
        rows.ask("posture", lambda: _check_posture(cell, plan, positions))
        rows.ask("start", lambda: _check_start(plan, cell, site, positions))
    if identity:
        # The verification has no tolerance at the start; the robot's distance from it was checked
        # above.
        verdict = verify(plan, cell, start=plan.segments[0].trajectory.positions[0])
        checked = verdict
        rows.ask("verification", lambda: _check_verdict(checked))
        first = finished.count(site.name, plan.content_hash) == 0
        limit = FIRST_RUN_SPEED if site.commissioning and first else 1.0
        fastest = tip_speed(plan, cell)
        most = min(limit, most_speed(site, fastest), governed_speed(site, plan, cell))
        rows.ask("speed", lambda: check_speed(used, limit))
        rows.ask("governor", lambda: check_governor(site, plan, cell, used))
        rows.ask("groups", lambda: check_groups(site, plan))
        rows.ask("tips", lambda: check_tips(site, fastest, used))
        rows.ask("clearances", lambda: check_margins(checked, cell, site))
    rows.ask("calibration", lambda: check_calibration(site, day))
    rows.ask("grippers", lambda: _check_grippers(site, plan, grippers))
    rows.ask("log", lambda: check_log(log))
    banners = [VIRTUAL_BANNER] * site.virtual + [COMMISSIONING_BANNER] * site.commissioning
    return Preflight(tuple(rows.checks), verdict, used, most, "; ".join(banners))


def recheck(
    preflight: Preflight,
    plan: FlatteningPlan,
    cell: Cell,
    site: Site,
    feedback: JointFeedback | None,
    status: DriverStatus | None,
    now: float,
) -> str:
    """Repeat, after the confirmation, the preflight checks whose result may have changed.

    Returns:
        Why motion may not start; empty if it may.
    """
    rows = _CheckList()
    rows.ask("controller", lambda: _check_driver(status))
    rows.ask("robot", lambda: _check_robot(status))
    if rows.ask("feedback", lambda: _check_feedback(site, feedback, now)) and feedback is not None:
        positions = feedback.positions
        rows.ask("start", lambda: _check_start(plan, cell, site, positions))
    again = Preflight(tuple(rows.checks), preflight.verdict, preflight.speed)
    if preflight.passed and again.passed:
        return ""
    return (preflight if not preflight.passed else again).summary()


class _CheckList:
    """Collect check results: a check returns its text, and fails with an `InputError`."""

    def __init__(self) -> None:
        self.checks: list[PreflightCheck] = []

    def ask(self, name: str, check: Callable[[], str]) -> bool:
        try:
            text, passed = check(), True
        except InputError as error:
            text, passed = str(error), False
        self.checks.append(PreflightCheck(name, passed, text))
        return passed


def _check_plan(plan: FlatteningPlan, cell: Cell) -> str:
    plan.check_made_for(cell)
    if not plan.segments:
        raise InputError("the plan has no segment; plan again")
    return f"{plan.content_hash[:12]}, for this cell and its limits"


def _check_driver(status: DriverStatus | None) -> str:
    if status is None or status.state == OFFLINE:
        raise InputError("the controller is not connected")
    if status.state == FAULT:
        raise InputError(status.reason)
    if status.state != READY:
        raise InputError(f"the driver is {status.state}, not ready: {status.reason or 'wait'}")
    return "connected; no other program here drives the robot"


def _in_motion(status: DriverStatus | None) -> bool:
    """Return whether the robot's status reports motion: its posture is then not checked yet."""
    return status is not None and status.robot is not None and status.robot.in_motion == 1


def _check_robot(status: DriverStatus | None) -> str:
    robot = None if status is None else status.robot
    if robot is None:
        raise InputError("the robot's status has not arrived; is its state server running?")
    if robot.problem:
        raise InputError(robot.problem)
    if robot.in_motion == 1:
        raise InputError("the robot is moving, or motion is left in its controller's queues")
    return "play mode, no alarm, no emergency stop" + (
        "" if robot.drives_powered == 1 else "; servo power comes with the first motion"
    )


def _check_feedback(site: Site, feedback: JointFeedback | None, now: float) -> str:
    if feedback is None:
        raise InputError("no joint feedback has arrived; is the controller's state server running?")
    age, most = now - feedback.received, site.controller.hold_after
    if not age <= most:
        raise InputError(
            f"the last joint feedback is {age:.2f} s old, at most {most:.2f} s is allowed; is the "
            "connection alive?"
        )
    if feedback.positions.shape != (13,) or not np.isfinite(feedback.positions).all():
        raise InputError(
            "the joint feedback is not thirteen finite numbers; check the site's groups"
        )
    return f"{1e3 * max(age, 0.0):.0f} ms old"


def _check_posture(cell: Cell, plan: FlatteningPlan, positions: np.ndarray) -> str:
    closed = plan.segments[0].closed if plan.segments else (False, False)
    posture = check_posture(cell, positions, closed)
    if posture.problems:
        raise InputError("; ".join(posture.problems) + "; " + escape(cell, positions, closed))
    near = f"smallest clearance {1e3 * posture.margin:.0f} mm above its padding"
    return "within limits; " + (near if np.isfinite(posture.margin) else "no two bodies are near")


def _check_start(plan: FlatteningPlan, cell: Cell, site: Site, positions: np.ndarray) -> str:
    if not plan.segments:
        raise InputError("the plan has no segment; plan again")
    off = positions - plan.segments[0].trajectory.positions[0]
    most = np.array(site.controller.start_tolerances)
    axis = int((np.abs(off) / most).argmax())
    worst = abs(float(off[axis]))
    if not worst <= most[axis]:
        far = np.flatnonzero(np.abs(off) > most)
        moves = ", ".join(f"{cell.robot.axes[i]} by {np.degrees(-off[i]):+.3f} deg" for i in far)
        raise InputError(
            f"the robot is not at the plan's start: {cell.robot.axes[axis]} is off by "
            f"{1e3 * worst:.2f} mrad, at most {1e3 * most[axis]:.2f} mrad is allowed; jog the "
            f"robot there with the pendant: {moves}"
        )
    return f"within {1e3 * np.abs(off).max():.2f} mrad of the plan's start"


def _check_verdict(verdict: Verdict) -> str:
    if not verdict.passed:
        more = len(verdict.violations) - 1
        rest = f" (and {more} more)" if more else ""
        raise InputError(f"{verdict.violations[0].message}{rest}; plan again")
    return verdict.summary()


def _check_grippers(site: Site, plan: FlatteningPlan, grippers: GripperState | None) -> str:
    if site.grippers.kind == "none":
        return "this site has no grippers: gripper events are pauses, no cloth is held"
    if grippers is None:
        raise InputError("the grippers did not report; see `unwrinkle site check`")
    if grippers.reason:
        raise InputError(f"{grippers.reason}; see `unwrinkle site check`")
    required = plan.segments[0].closed if plan.segments else grippers.closed
    for side, closed, needed in zip(("right", "left"), grippers.closed, required, strict=True):
        if closed != needed:
            raise InputError(
                f"the {side} gripper is {'closed' if closed else 'open'}, but the plan starts with "
                f"it {'closed' if needed else 'open'}; check what it holds, and set it with the "
                "pendant's outputs"
            )
    return f"{site.grippers.kind}: the grippers answer"
