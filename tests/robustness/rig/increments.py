"""What the controller runs of a plan at full speed.

Increments of its clock, held against the plan's limits and path.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.robustness.rig.driver_rig import Rig
from unwrinkle.models.arrays import Array
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
from unwrinkle.testing import cells


@dataclass(frozen=True)
class Increments:
    """What the controller ran of a plan at full speed.

    Attributes:
        profile: of the site.
        period: of the controller's clock, s.
        completed: every segment ran to its end.
        velocity, acceleration, jerk: greatest share of a limit in the increments' differences.
        path_error: of the increments, rad.
        queue_least, queue_median: motion in the queues while the axes move, but for each segment's
            last `lead`, s.
        underruns: of the queues.
        audit: what the client should not have sent.
    """

    profile: str
    period: float
    completed: bool
    velocity: float
    acceleration: float
    jerk: float
    path_error: float
    queue_least: float
    queue_median: float
    underruns: int
    audit: tuple[str, ...]


#: The axes begin to move within this, ms.
_LATEST = 1500


def run_increments(folder: Path, profile: str, period: float) -> Increments:
    """Run a dual-arm plan at full speed through the driver and judge the increments.

    Args:
        folder: for the run's log.
        profile: of the site.
        period: of the controller's clock, s.
    """
    plan = cells.plan()
    settings = VirtualControllerSettings(period=period, keep=100_000)
    name = f"increments-{profile}-{1e3 * period:g}"
    ratios, errors, queued = np.zeros(3), [0.0], list[float]()
    completed = True
    with Rig(folder, site={"profile": profile}, settings=settings, name=name) as rig:
        if not rig.connect():
            raise RuntimeError(rig.status.reason)
        for segment in plan.segments:
            begin = len(rig.controller.trace)
            number = rig.run(segment.trajectory, segment.name)
            levels = list[tuple[float, float]]()

            def done(number: int = number, levels: list[tuple[float, float]] = levels) -> bool:
                if np.abs(rig.controller.velocities).max() > 1e-3:
                    levels.append((rig.status.progress, min(rig.controller.queued_time)))
                return rig.status.completed >= number or bool(rig.status.reason)

            rig.until(done, 20.0)
            completed &= rig.status.completed >= number
            sent = as_sent(segment.trajectory)
            last = sent.duration - rig.site.lead
            queued += [level for progress, level in levels if progress < last]
            q = np.array([positions for _, positions, _ in list(rig.controller.trace)[begin:]])
            ratios = np.maximum(ratios, _shares(q, period, rig))
            errors.append(_path_error(q, period, sent))
        return Increments(
            profile=profile,
            period=period,
            completed=completed,
            velocity=float(ratios[0]),
            acceleration=float(ratios[1]),
            jerk=float(ratios[2]),
            path_error=max(errors),
            queue_least=min(queued),
            queue_median=float(np.median(queued)),
            underruns=rig.controller.underruns,
            audit=tuple(rig.controller.audit.findings)[:5],
        )


def _shares(q: Array, period: float, rig: Rig) -> Array:
    """Greatest share of the velocity, acceleration and jerk limit in the differences of positions
    (n, 13).
    """
    limits, found, values = rig.limits, list[float](), q
    for bound in (limits.velocity, limits.acceleration, limits.jerk):
        values = np.diff(values, axis=0) / period
        found.append(float((np.abs(values) / bound).max()))
    return np.array(found)


def _path_error(q: Array, period: float, sent: Trajectory) -> float:
    """Greatest distance of an axis from the plan, once a delay of whole milliseconds is taken out,
    rad.
    """
    curve = sent.interpolant()
    times = np.arange(len(q)) * period

    def error(delay: int) -> float:
        since = np.clip(times - 1e-3 * delay, 0.0, sent.duration)
        return float(np.abs(q - curve(since)).max())

    return min(error(delay) for delay in range(_LATEST))
