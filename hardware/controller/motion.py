"""The motion under way: the point stream of one trajectory, the commands that it completes, and its
arrival.
"""

from dataclasses import dataclass

import numpy as np

from unwrinkle.hardware.controller.finding import FaultCause, Finding
from unwrinkle.hardware.controller.monitor import AXIS_NAMES
from unwrinkle.hardware.controller_state import JointFeedback
from unwrinkle.hardware.streaming.stream import PointStream
from unwrinkle.models.arrays import Array
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.arrival import (
    ARRIVAL_TIME_S,
    ARRIVED_POSITION_RAD,
    ARRIVED_SPEED_RAD_S,
)


@dataclass(eq=False)
class Motion:
    """One trajectory on its way to the controller, from its start until another one replaces it.

    Attributes:
        site: start tolerances and latency.
        stream: sends its points.
        number: command that is completed at the trajectory's end; a resume replaces it.
        most_override: greatest speed override that the controller's speed governor allows.
        hold_number: command that is completed at rest after a hold; 0 for none.
        rest_since: when everything sent so far had been run, s; None while the robot has to move.
        was_possible: the robot has reported that motion is possible since the trajectory began.
    """

    site: ControllerSite
    stream: PointStream
    number: int
    most_override: float
    hold_number: int = 0
    rest_since: float | None = None
    was_possible: bool = False

    def arrived(self, now: float, feedback: JointFeedback) -> bool:
        """Return whether feedback that came since the motion ended shows the robot at rest at its
        last point.

        Args:
            now: driver's clock, s; the first call marks the motion's end.
            feedback: newest set.
        """
        if self.rest_since is None:
            self.rest_since = now
        return bool(
            feedback.received > self.rest_since
            and (self._distance(feedback) <= self._tolerance()).all()
            and np.abs(feedback.velocities).max() <= ARRIVED_SPEED_RAD_S
        )

    def arrival_overdue(self, now: float, feedback: JointFeedback) -> Finding | None:
        """Return a finding if the robot should have arrived by now."""
        assert self.rest_since is not None
        if now - self.rest_since <= ARRIVAL_TIME_S + self.site.latency:
            return None
        off, most = self._distance(feedback), self._tolerance()
        axis = int((off / most).argmax())
        return Finding(
            FaultCause.ARRIVAL,
            f"{AXIS_NAMES[axis]} is still {1e3 * off[axis]:.2f} mrad off where the motion ended "
            f"{now - self.rest_since:.1f} s ago, at most {1e3 * most[axis]:.2f} mrad, or moves",
        )

    def _distance(self, feedback: JointFeedback) -> Array:
        """Return the distance of each axis from the last point sent, (13,) rad."""
        last = self.stream.clock.last
        assert last is not None
        return np.abs(feedback.positions - last.positions)

    def _tolerance(self) -> Array:
        """Return the largest distance at which an axis has arrived, (13,) rad: the next motion
        begins there.
        """
        return np.minimum(self.site.start_tolerances, ARRIVED_POSITION_RAD)
