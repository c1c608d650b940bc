"""Everything that has to be right before anything moves: one row per check, and one verdict on the plan.

Nothing here moves the robot, and nothing that is wrong is put right silently: it is said, with what to try.
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
    check_calibration,
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

#: A commissioning site's first run of a plan is at this speed at most.
FIRST_RUN_SPEED = 0.1
VIRTUAL_BANNER = "VIRTUAL EQUIPMENT: the nominal calibration stands in for a measured one"
COMMISSIONING_BANNER = (
    "COMMISSIONING: tips at most 0.25 m/s, doubled clearances, dead-man key, first run at 10 %"
)


@dataclass(frozen=True)
class PreflightCheck:
    """One check.

    Attributes:
        name: one or two words.
        passed: whether it is right.
        text: what was found; where it is wrong, by how much and what to try.
    """

    name: str
    passed: bool
    text: str


@dataclass(frozen=True)
class Preflight:
    """All checks.

    Attributes:
        checks: in order.
        verdict: of the verification; None where the plan is of another cell.
        speed: share of the planned speed that was checked.
        most_speed: share that the run may be raised to.
        banner: what the operator has to be told in any case; may be empty.
    """

    checks: tuple[PreflightCheck, ...]
    verdict: Verdict | None
    speed: float
    most_speed: float = 1.0
    banner: str = ""

    @property
    def passed(self) -> bool:
        """Whether motion may begin."""
        return all(check.passed for check in self.checks)

    @property
    def failures(self) -> tuple[PreflightCheck, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if not check.passed)

    def check(self, name: str) -> PreflightCheck:
        """The check of that name.

        Raises:
            KeyError: there is none.
        """
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)

    def summary(self) -> str:
        """One sentence."""
        if self.passed:
            return "all preflight checks passed"
        return "motion refused: " + "; ".join(f"{c.name}: {c.text}" for c in self.failures)


class GrippersSay(Protocol):
    """What is asked of the grippers' report."""

    @property
    def closed(self) -> tuple[bool, bool]:
        """Whether they are closed, right and left."""
        ...

    @property
    def reason(self) -> str:
        """Why they do not answer or work; empty if they do."""
        ...


def chosen_speed(
    site: Site, plan: FlatteningPlan, wanted: float | None, finished: FinishedRuns
) -> float:
    """Share of the planned speed to execute at: what is wanted, else the site's, slower in a commissioning's first run."""
    if wanted is not None:
        return wanted
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
    grippers: GrippersSay | None = None,
    log: Path | None = None,
    finished: FinishedRuns | None = None,
    today: datetime.date | None = None,
) -> Preflight:
    """Check all that has to be right before a plan is executed.

    Args:
        plan: to be executed.
        cell: where it is.
        site: with what.
        feedback: the last of the robot; None if none came.
        status: of the driver; None if there is none.
        now: on the driver's clock, s.
        speed: share of the planned speed; the site's if left out.
        grippers: their report; None where none could be asked.
        log: file of the run log; None for a dry run that keeps none.
        finished: which plans were run before; the user's own record if left out.
        today: for the calibration's age.

    Returns:
        The checks; a plan that may not be run is a value, not an exception.
    """
    finished = FinishedRuns() if finished is None else finished
    day = datetime.date.today() if today is None else today
    used = chosen_speed(site, plan, speed, finished)
    rows = _Rows()
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
        # The verification knows no tolerance at the start: how far the robot is from there was just checked.
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


def last_look(
    preflight: Preflight,
    plan: FlatteningPlan,
    cell: Cell,
    site: Site,
    feedback: JointFeedback | None,
    status: DriverStatus | None,
    now: float,
) -> str:
    """Look again at what can have changed since the preflight, after the operator has agreed.

    Returns:
        Why motion may not begin; empty if it may.
    """
    rows = _Rows()
    rows.ask("controller", lambda: _check_driver(status))
    rows.ask("robot", lambda: _check_robot(status))
    if rows.ask("feedback", lambda: _check_feedback(site, feedback, now)) and feedback is not None:
        positions = feedback.positions
        rows.ask("start", lambda: _check_start(plan, cell, site, positions))
    again = Preflight(tuple(rows.checks), preflight.verdict, preflight.speed)
    if preflight.passed and again.passed:
        return ""
    return (preflight if not preflight.passed else again).summary()


class _Rows:
    """Collects the checks: what a check returns is its text, and an `InputError` is its failure."""

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
    return "connected, and nobody else drives it from here"


def _in_motion(status: DriverStatus | None) -> bool:
    """Whether the robot's status reports motion: then where it stands says nothing yet."""
    return status is not None and status.robot is not None and status.robot.in_motion == 1


def _check_robot(status: DriverStatus | None) -> str:
    robot = None if status is None else status.robot
    if robot is None:
        raise InputError("no status of the robot has come; is its state server running?")
    if robot.problem:
        raise InputError(robot.problem)
    if robot.in_motion == 1:
        raise InputError("the robot is moving, or motion is left in its controller's queues")
    return "play mode, no alarm, no emergency stop" + (
        "" if robot.drives_powered == 1 else "; servo power comes with the first motion"
    )


def _check_feedback(site: Site, feedback: JointFeedback | None, now: float) -> str:
    if feedback is None:
        raise InputError("no joint feedback has come; is the controller's state server running?")
    age, most = now - feedback.received, site.controller.hold_after
    if not age <= most:
        raise InputError(
            f"the last joint feedback is {age:.2f} s old, at most {most:.2f} s; is the connection alive?"
        )
    if feedback.positions.shape != (13,) or not np.isfinite(feedback.positions).all():
        raise InputError("the joint feedback is not thirteen finite numbers")
    return f"{1e3 * max(age, 0.0):.0f} ms old"


def _check_posture(cell: Cell, plan: FlatteningPlan, positions: np.ndarray) -> str:
    closed = plan.segments[0].closed if plan.segments else (False, False)
    posture = check_posture(cell, positions, closed)
    if posture.problems:
        raise InputError("; ".join(posture.problems) + "; " + escape(cell, positions, closed))
    near = f"{1e3 * posture.margin:.0f} mm more than its padding"
    return "within limits; " + (near if np.isfinite(posture.margin) else "nothing is near")


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
            f"the robot stands away from the plan's start: {cell.robot.axes[axis]} by {1e3 * worst:.2f} mrad, "
            f"at most {1e3 * most[axis]:.2f} mrad; jog it there with the pendant: {moves}"
        )
    return f"within {1e3 * np.abs(off).max():.2f} mrad of the plan's start"


def _check_verdict(verdict: Verdict) -> str:
    if not verdict.passed:
        more = len(verdict.violations) - 1
        rest = f" (and {more} more)" if more else ""
        raise InputError(f"{verdict.violations[0].message}{rest}; plan again")
    return verdict.summary()


def _check_grippers(site: Site, plan: FlatteningPlan, grippers: GrippersSay | None) -> str:
    if site.grippers.kind == "none":
        return "this site has none: the plan's gripper events become pauses, no cloth is held"
    if grippers is None:
        raise InputError("the grippers were not asked")
    if grippers.reason:
        raise InputError(f"{grippers.reason}; see `unwrinkle site check`")
    wanted = plan.segments[0].closed if plan.segments else grippers.closed
    for side, closed, want in zip(("right", "left"), grippers.closed, wanted, strict=True):
        if closed != want:
            raise InputError(
                f"the {side} gripper is {'closed' if closed else 'open'}, the plan begins with it "
                f"{'closed' if want else 'open'}; see what it holds, and set it with the pendant's outputs"
            )
    return f"{site.grippers.kind}: they answer"
