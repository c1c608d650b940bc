"""How long a hold takes and how far the tools travel meanwhile, by the site's settings.

A hold is commanded at a time of the path. The points sent ahead (`controller.lead`) still run;
braking along the path follows, as the driver computes it; the axes follow the commands
`controller.latency` later. Nothing of this is measured, and nothing of it is a safety function: the
stop category of the hardware, and its stopping time and distance, are data of the controller and
the robot.
"""

from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.streaming.path_clock import PathClock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verifier import cell_model

#: Time of the path between the holds that are computed, s.
HOLD_STEP = 0.1
#: Postures at which the tools' ways are measured.
_POSTURES = 64


@dataclass(frozen=True)
class HoldTravel:
    """One hold.

    Attributes:
        time: of the command, on the plan's clock, s.
        segment: name of the segment that runs.
        lead: part of the duration in which points sent before still run, s.
        braking: part of the duration in which the commands brake, s.
        latency: delay of the axes behind the commands, s.
        travel: way of the tool centre point that moves farther, from the command to rest, m.
    """

    time: float
    segment: str
    lead: float
    braking: float
    latency: float
    travel: float

    @property
    def duration(self) -> float:
        """From the command to the rest of the axes, s."""
        return self.lead + self.braking + self.latency


def hold_travels(
    plan: FlatteningPlan,
    cell: Cell,
    site: ControllerSite,
    rate: float,
    *,
    step: float = HOLD_STEP,
) -> tuple[HoldTravel, ...]:
    """Compute a hold at even times of a plan.

    Args:
        plan: made for the cell.
        cell: with the limits that braking keeps.
        site: lead and latency.
        rate: share of the plan's speed at which it runs.
        step: time of the path between two holds, s.
    """
    limits = StreamLimits.of(cell.limits)
    found = []
    for segment in plan.segments:
        trajectory = segment.trajectory
        for s in np.arange(0.5 * step, trajectory.duration, step):
            now = float(s) / rate
            clock = PathClock(trajectory, limits, rate=rate)
            sent = clock.next_until(now + site.lead)[-1]
            clock.set_rate(0.0)
            last = ([sent, *clock.next_until(np.inf)])[-1]
            lead = max(sent.time - now, 0.0)
            seen = max(now - site.latency, 0.0) * rate
            found.append(
                HoldTravel(
                    time=segment.start + float(s),
                    segment=segment.name,
                    lead=lead,
                    braking=last.time - sent.time,
                    latency=site.latency,
                    travel=_way(cell, trajectory.at(np.linspace(seen, last.s, _POSTURES))[0]),
                )
            )
    return tuple(found)


def _way(cell: Cell, positions: Array) -> float:
    """Return the longer way of both tool centre points through postures (n, 13), m."""
    openings = np.full((len(positions), 2), cell.scenario.gripper.opening)
    _, X_WT = cell_model(cell).frames(np.hstack([positions, openings]))
    steps = np.linalg.norm(np.diff(X_WT[:, :, :3, 3], axis=0), axis=2)
    return float(steps.sum(axis=0).max())
