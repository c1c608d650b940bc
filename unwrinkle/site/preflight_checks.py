"""Preflight checks of speed, clearances and log.

Each returns what it found, or raises `InputError`.
"""

import os
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from unwrinkle.hardware.streaming.firmware_limits import speed_shares, unmoved_group
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import Clearances
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.motion import legs
from unwrinkle.planning.verification.verdict import NEAR_BY_DESIGN, Verdict
from unwrinkle.planning.verification.verifier import cell_model

#: Maximum speed of the tool centre points under commissioning, m/s: the reduced speed of manual
#: operation.
COMMISSIONING_TIP_SPEED = 0.25
#: Factor by which a tip may be faster between two samples than at both of them.
_BETWEEN_SAMPLES = 1.01
#: Minimum free disk space for a run log, bytes; a log takes about 100 kB per second.
LEAST_ROOM = 64 << 20


def check_speed(speed: float, most: float) -> str:
    """Check the share of the planned speed.

    `most` is below 1 in a first run under commissioning.
    """
    if not 0.0 < speed <= 1.0:
        raise InputError(f"the speed is {speed:g}; give a fraction above 0, up to 1")
    if speed > most:
        raise InputError(
            f"the speed is {speed:g}, but this plan has not been run to its end at this site; the "
            f"maximum of the first run is {most:g}: give --speed {most:g} or less"
        )
    return f"{speed:g} of the planned speed"


def check_tips(site: Site, fastest: float, speed: float) -> str:
    """Check the speed of the tool centre points under commissioning.

    `fastest` is that at the planned speed, m/s.
    """
    most = most_speed(site, fastest)
    text = f"tool centre points at most {speed * fastest:.2f} m/s, 1 % for times between samples"
    if speed > most:
        raise InputError(
            f"{text}, under commissioning {COMMISSIONING_TIP_SPEED:g} m/s is allowed; give --speed "
            f"{most:g} or less"
        )
    return text


def most_speed(site: Site, fastest: float) -> float:
    """Return the share of the planned speed that a site allows.

    `fastest` is the tips' speed in the plan, m/s.
    """
    if not site.commissioning or fastest <= COMMISSIONING_TIP_SPEED:
        return 1.0
    return float(np.floor(1000.0 * COMMISSIONING_TIP_SPEED / fastest) / 1000.0)


def governed_speed(site: Site, plan: FlatteningPlan, cell: Cell) -> float:
    """Return the largest share of a plan's speed that respects the controller's speed cap."""
    used = _used_speeds(plan, cell).max()
    cap = site.controller.speed_cap
    return 1.0 if used <= cap else float(np.floor(1000.0 * cap / used) / 1000.0)


def check_governor(site: Site, plan: FlatteningPlan, cell: Cell, speed: float) -> str:
    """Check that no point of the plan exceeds the controller's speed cap."""
    used, cap = _used_speeds(plan, cell), site.controller.speed_cap
    axis = int(used.argmax())
    text = f"at most {speed * used[axis]:.0%} of an axis' speed ({cell.robot.axes[axis]})"
    if not speed * used[axis] <= cap:
        most = governed_speed(site, plan, cell)
        raise InputError(
            f"{text}, the controller refuses more than {cap:.0%} (controller.speed_cap) during a "
            f"motion; give --speed {most:g} or less, or raise the controller's governor (parameter "
            "RCnG147) and the site's key"
        )
    return text


def _used_speeds(plan: FlatteningPlan, cell: Cell) -> np.ndarray:
    """Return the largest share of each axis' full speed among the plan's points, (13,)."""
    trajectories = [segment.trajectory for segment in plan.segments]
    return speed_shares(trajectories, cell.with_speed(1.0).limits.velocity)


def check_groups(site: Site, plan: FlatteningPlan) -> str:
    """Check that the plan moves only groups that the firmware moves."""
    moved = site.controller.groups_moved
    if still := unmoved_group([segment.trajectory for segment in plan.segments], moved):
        raise InputError(still)
    return f"the plan moves only {', '.join(moved)}"


def tip_speed(plan: FlatteningPlan, cell: Cell) -> float:
    """Return the largest speed of a tool centre point in a plan at full speed, m/s."""
    model, fastest = cell_model(cell), 0.0
    directions = model.axis_directions()
    for leg in legs(plan, cell.scenario.gripper.opening):
        X_WJ, X_WT = model.frames(leg.positions)
        for arm, chain in enumerate(model.tool_chains):
            p_WT = X_WT[:, arm, :3, 3]
            v = np.zeros_like(p_WT)
            for joint in chain:
                z = X_WJ[:, joint, :3, :3] @ directions[joint]
                v += leg.velocities[:, joint, None] * np.cross(z, p_WT - X_WJ[:, joint, :3, 3])
            fastest = max(fastest, float(np.linalg.norm(v, axis=1).max()))
    return _BETWEEN_SAMPLES * fastest


def check_margins(verdict: Verdict, cell: Cell, site: Site) -> str:
    """Check that distances are at least twice the shipped cell's clearances under commissioning."""
    near = verdict.smallest
    text = "no two bodies come near" if near is None else f"smallest {1e3 * near.distance:.1f} mm"
    if not site.commissioning:
        return text
    doubled = {kind: 2.0 * value for kind, value in asdict(Clearances()).items()}
    used = asdict(cell.scenario.clearance)
    for pair in verdict.clearances:
        kind = pair.kind.replace("-", "_")
        if pair.kind in NEAR_BY_DESIGN or kind not in doubled:
            continue
        required = max(doubled[kind], used[kind])
        if pair.distance < required:
            raise InputError(
                f"{' and '.join(pair.bodies)} come within {1e3 * pair.distance:.1f} mm at "
                f"{pair.time:.2f} s, under commissioning {1e3 * required:.0f} mm are required; "
                "plan with a scenario of doubled clearances"
            )
    return f"{text}; doubled clearances are kept"


def check_log(log: Path | None) -> str:
    """Check that the run log can be written and has room; None for a dry run without a log."""
    if log is None:
        return "no log in this dry run"
    folder = log.resolve().parent
    while not folder.exists():
        folder = folder.parent
    try:
        if log.exists():
            with log.open("ab"):
                pass
        else:
            with tempfile.TemporaryFile(dir=folder):
                pass
        room = os.statvfs(folder)
    except OSError as error:
        raise InputError(
            f"{log}: cannot be written ({error.strerror or error}); name a file elsewhere with "
            "--log"
        ) from None
    free = room.f_bavail * room.f_frsize
    if free < LEAST_ROOM:
        raise InputError(
            f"{log}: {free >> 20} MB are free there, at least {LEAST_ROOM >> 20} MB are needed; "
            "free disk space, or name a file elsewhere with --log"
        )
    return str(log)
