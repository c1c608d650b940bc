"""Collect the evidence on a plan at a site: figures, hashes, versions, assumptions, verdict."""

import datetime
import hashlib
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from unwrinkle.evidence.body_motion import BodyMotion, body_motions
from unwrinkle.evidence.motion import SAMPLE_STEP, SampledMotion, sampled_motion
from unwrinkle.evidence.stopping import HoldTravel, hold_travels
from unwrinkle.evidence.swept import SweptSpace, swept_space
from unwrinkle.models.errors import InputError, NoVerifiedPlanError
from unwrinkle.models.robot import Cell, scoped
from unwrinkle.models.scenario import resolve, shipped_scenario
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.site.preflight_checks import (
    check_governor,
    check_groups,
    check_margins,
    check_tips,
    governed_speed,
    most_speed,
    tip_speed,
)
from unwrinkle.site.sites import find_site, site_cell, site_file
from unwrinkle.systems.station.preconditions import check_calibration

#: Packages whose versions decide the figures.
_PACKAGES = ("unwrinkle", "drake", "numpy", "scipy", "toppra", "ruckig", "opencv-python-headless")
_ASSUMPTIONS = """
The plan is verified against the model of the cell: rigid bodies with the shapes, poses and limits
of the model files named by the hashes. Whether the model fits the real cell has to be checked
there.

People, cables, the garment and whatever else is not in the model are not considered.

Masses and inertias are those of the model files, without motor rotors, hoses and the garment. Those
of the shipped CloPeMa robot are ASSUMED: values of a CAD model, scaled to the catalogue mass.

Speeds and energies are the greatest of samples at most {step:g} ms apart, for the motion as
planned. The speed of a body is that of the fastest corner of the boxes around its shapes.

The swept space counts each voxel of {voxel:g} mm that a shape may touch at or between the samples;
it is too large rather than too small. It covers the plan alone, not what a hold, a retreat or a
fault adds.

A hold is computed with controller.lead = {lead:g} s, controller.latency = {latency:g} s and the
limits of acceleration and jerk, as set. None of them is measured by this software, and the shipped
ones are ASSUMED.

Emergency and protective stops, their stop category, stopping time and distance are those of the
robot and its controller; they are not computed here.

Another speed, site, scenario or plan needs another document.
"""
#: The turn-table and what it carries beside the arms.
_REST = "turn-table and head"


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a risk assessment can cite about one plan at one site.

    Attributes:
        plan: the plan, verified against the model of the site's cell.
        plan_file: file of the plan.
        site: the site.
        verdict: of the verification.
        speed: share of the plan's speed at which the site runs it.
        speed_reason: where that share comes from.
        site_checks: checks of the site's settings: name, whether it passed, what was found.
        motion: samples of the plan's motion at the plan's own speed.
        bodies: greatest speeds and energies, at the plan's own speed.
        tools: names of the arms, each with the greatest speed of its tool centre point at the
            plan's own speed, m/s, and the plan's time of it, s.
        space: voxels that the bodies pass.
        holds: holds all over the plan at `speed`.
        hashes: SHA-256 (hex) by name.
        versions: of the software, by name.
        made: date and time, UTC.
    """

    plan: FlatteningPlan
    plan_file: str
    site: Site
    verdict: Verdict
    speed: float
    speed_reason: str
    site_checks: tuple[tuple[str, bool, str], ...]
    motion: SampledMotion
    bodies: tuple[BodyMotion, ...]
    tools: tuple[tuple[str, float, float], ...]
    space: SweptSpace
    holds: tuple[HoldTravel, ...]
    hashes: dict[str, str]
    versions: dict[str, str]
    made: str

    @property
    def worst_hold(self) -> HoldTravel:
        """The hold with the longest way."""
        return max(self.holds, key=lambda hold: hold.travel)

    @property
    def total_energy(self) -> tuple[float, float]:
        """Greatest kinetic energy of the robot at the plan's own speed, J, and its time, s."""
        k = int(self.motion.total_energies.argmax())
        return float(self.motion.total_energies[k]), float(self.motion.times[k])

    @property
    def longest_hold(self) -> HoldTravel:
        """The hold that takes longest."""
        return max(self.holds, key=lambda hold: hold.duration)

    def to_json(self) -> dict[str, Any]:
        """Convert to plain lists, numbers and strings; units are in the names."""
        share = self.speed
        return {
            "format": "unwrinkle evidence",
            "format_version": 1,
            "made": self.made,
            "plan_file": self.plan_file,
            "site": self.site.name,
            "hashes": self.hashes,
            "versions": self.versions,
            "speed_share": share,
            "speed_reason": self.speed_reason,
            "site_checks": [
                {"name": name, "passed": passed, "text": text}
                for name, passed, text in self.site_checks
            ],
            "tools": [
                {
                    "arm": name,
                    "speed_planned_m_s": speed,
                    "speed_at_site_m_s": share * speed,
                    "time_s": time,
                }
                for name, speed, time in self.tools
            ],
            "bodies": [
                {
                    "name": body.name,
                    "mass_kg": body.mass,
                    "speed_planned_m_s": body.speed,
                    "speed_at_site_m_s": share * body.speed,
                    "speed_time_s": body.speed_time,
                    "energy_planned_J": body.energy,
                    "energy_at_site_J": share**2 * body.energy,
                    "energy_time_s": body.energy_time,
                    "lower_m": body.lower,
                    "upper_m": body.upper,
                }
                for body in self.bodies
            ],
            "total_energy_planned_J": self.total_energy[0],
            "total_energy_at_site_J": share**2 * self.total_energy[0],
            "swept_space": {
                "resolution_m": self.space.resolution,
                "groups": [self._swept(group) for group in self.space.groups],
                "all": self._swept(None),
            },
            "holds": [{**asdict(hold), "duration": hold.duration} for hold in self.holds],
            "verdict": self.verdict.to_json(),
            "assumptions": list(assumptions(self)),
        }

    def _swept(self, group: str | None) -> dict[str, Any]:
        low, high = self.space.bounds(group)
        return {
            "name": group or "all",
            "volume_m3": self.space.volume(group),
            "lower_m": low.tolist(),
            "upper_m": high.tolist(),
        }


def collect_evidence(plan_file: str | Path, site: str | Path) -> Evidence:
    """Verify a plan against the model of a site's cell, and compute the figures.

    Args:
        plan_file: of `unwrinkle plan`.
        site: file of a site, or name of a shipped one.

    Raises:
        InputError: a file is missing or damaged, the plan was made for another cell, or it moves
            what the site's controller does not move or comes nearer than the site permits.
        NoVerifiedPlanError: the plan does not pass its verification.
    """
    plan, found = FlatteningPlan.load(plan_file), find_site(site)
    cell = site_cell(found)
    plan.check_made_for(cell)
    verdict = verify(plan, cell)
    if not verdict.passed:
        raise NoVerifiedPlanError(verdict.summary())
    speed, reason = _speed(plan, cell, found)
    motion = sampled_motion(plan, cell)
    return Evidence(
        plan=plan,
        plan_file=Path(plan_file).name,
        site=found,
        verdict=verdict,
        speed=speed,
        speed_reason=reason,
        site_checks=_site_checks(plan, cell, found, verdict, speed),
        motion=motion,
        bodies=body_motions(motion),
        tools=_tools(motion, cell),
        space=swept_space(motion, _groups(motion, cell)),
        holds=hold_travels(plan, cell, found.controller, speed),
        hashes=_hashes(plan, Path(plan_file), found, site_file(site), verdict),
        versions=_versions(),
        made=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    )


def assumptions(evidence: Evidence) -> tuple[str, ...]:
    """Return what the figures rest on, a few sentences each."""
    controller, voxel = evidence.site.controller, 1e3 * evidence.space.resolution
    text = _ASSUMPTIONS.format(
        step=1e3 * SAMPLE_STEP, voxel=voxel, lead=controller.lead, latency=controller.latency
    )
    return tuple(" ".join(part.split()) for part in text.strip().split("\n\n"))


def _speed(plan: FlatteningPlan, cell: Cell, site: Site) -> tuple[float, str]:
    """Return the share of the plan's speed that a site runs it at, and why."""
    shares = [
        (site.speed, "the site's speed"),
        (most_speed(site, tip_speed(plan, cell)), "commissioning: tips at most 0.25 m/s"),
        (governed_speed(site, plan, cell), "controller.speed_cap"),
    ]
    speed, reason = min(shares, key=lambda share: share[0])
    if not speed > 0.0:
        raise InputError(f"site {site.name} allows this plan no speed ({reason})")
    return speed, reason


def _site_checks(
    plan: FlatteningPlan, cell: Cell, site: Site, verdict: Verdict, speed: float
) -> tuple[tuple[str, bool, str], ...]:
    """Run the checks of the site's settings that need no device.

    Raises:
        InputError: the site does not permit the plan.
    """
    rows = [
        ("groups", True, check_groups(site, plan)),
        ("clearances", True, check_margins(verdict, cell, site)),
        ("tool speed", True, check_tips(site, tip_speed(plan, cell), speed)),
        ("axis speed", True, check_governor(site, plan, cell, speed)),
    ]
    today = datetime.datetime.now(datetime.UTC).date()
    return (*rows, _row("head calibration", lambda: check_calibration(site, today)))


def _row(name: str, check: Callable[[], str]) -> tuple[str, bool, str]:
    try:
        return name, True, check()
    except InputError as error:
        return name, False, str(error)


def _tools(motion: SampledMotion, cell: Cell) -> tuple[tuple[str, float, float], ...]:
    speeds = np.linalg.norm(motion.v_WT, axis=2)
    rows = []
    for i, arm in enumerate(cell.robot.arms):
        k = int(speeds[:, i].argmax())
        rows.append((arm.name, float(speeds[k, i]), float(motion.times[k])))
    return tuple(rows)


def _groups(motion: SampledMotion, cell: Cell) -> dict[str, list[int]]:
    """Group the bodies by arm; the others are the turn-table and what it carries."""
    groups: dict[str, list[int]] = {}
    for b, name in enumerate(motion.names):
        arm = cell.robot.arm_of(scoped(name)[0])
        label = _REST if arm is None else f"{cell.robot.arms[arm].name} arm"
        groups.setdefault(label, []).append(b)
    return groups


def _hashes(
    plan: FlatteningPlan, plan_file: Path, site: Site, file: Path, verdict: Verdict
) -> dict[str, str]:
    scenario = resolve(site.scenario) if site.scenario else shipped_scenario()
    return {
        "plan": plan.content_hash,
        "model of the cell": verdict.robot_hash,
        "limits": verdict.limits_hash,
        f"plan file {plan_file.name}": _sha256(plan_file),
        f"site file {file.name}": _sha256(file),
        f"scenario file {scenario.name}": _sha256(scenario),
    }


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _versions() -> dict[str, str]:
    found = {"Python": platform.python_version(), "system": platform.platform()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
