"""Tolerances, deadlines and reactions of an execution: one set for every caller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from unwrinkle.flattening.execution.state import ExecutionFeedback
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import Site
from unwrinkle.planning.arrival import ARRIVED_POSITION_RAD, ARRIVED_SPEED_RAD_S


class LostCloth(StrEnum):
    """Reaction to cloth that leaves a closed gripper during a segment."""

    STOP = "stop"  # brake along the path, open at rest, end as failed: an operator decides
    FINISH = "finish"  # finish the verified motion, end as missed: the closed loop looks again


@dataclass(frozen=True)
class ExecutionSettings:
    """Tolerances, deadlines and reactions; times in s.

    The defaults are those of the simulated station in the closed loop.

    Attributes:
        position_tolerance: largest distance of an axis from a point at which the robot is, rad; of
            all axes, or of each. The arrival tolerance of the driver and of the simulated
            controller: where they report the end of a motion, the next one may begin.
        rest_speed: largest speed of an axis at rest, rad/s; the speed of the same arrival.
        answer: for a command to be accepted or refused. Drivers answer within 0.05 s; the driver's
            process holds by itself after as long without its owner.
        start_delay: from the acceptance of a motion to its begin: servo on, the controller's job,
            and the pause between two motions.
        rest: for the arms to be at rest at the start of a step; drivers allow 1 s and their
            latency for an arrival.
        motion: a segment may take this many times its duration at its speed, and `start_delay` and
            `answer` more: the speed follows a change of the override with a delay.
        brake: for a stop to come to rest; the driver stops all groups at once after as long.
        stop_delay: time after which a stop has reached a driver that is at rest.
        settle: for a robot in fault to come to rest on its servos' brakes; also the age of feedback
            beyond which its motion is unknown.
        gripper: for both grippers to finish a stroke.
        dead_man_timeout: time without a press after which the dead-man key is released; keyboards
            begin to repeat after 0.5 s.
        dead_man: whether motion requires the dead-man key.
        most_speed: greatest permitted share of the planned speed.
        lost_cloth: see `LostCloth`.
        attended: whether an operator can resume a motion that the driver holds by itself, for late
            feedback; without one, such a hold is a fault.
        leave_mode: whether the controller leaves trajectory mode at the end, so that the pendant
            can be used; the closed loop stays in it for the next action.
    """

    position_tolerance: float | tuple[float, ...] = ARRIVED_POSITION_RAD
    rest_speed: float = ARRIVED_SPEED_RAD_S
    answer: float = 2.0
    start_delay: float = 0.0
    rest: float = 2.0
    motion: float = 1.5
    brake: float = 10.0
    stop_delay: float = 0.1
    settle: float = 2.0
    gripper: float = 5.0
    dead_man_timeout: float = 0.7
    dead_man: bool = False
    most_speed: float = 1.0
    lost_cloth: LostCloth = LostCloth.FINISH
    attended: bool = False
    leave_mode: bool = False

    @classmethod
    def of_site(cls, site: Site) -> ExecutionSettings:
        """Return settings that allow for a site's tolerances and its devices' timeouts."""
        controller = site.controller
        each = np.minimum(controller.start_tolerances, ARRIVED_POSITION_RAD)
        return cls(
            position_tolerance=tuple(each.tolist()),
            start_delay=controller.start_timeout + controller.pause,
            gripper=site.grippers.timeout + 2.0,
        )

    def for_single_run(
        self, *, most_speed: float = 1.0, attended: bool = False, dead_man: bool = False
    ) -> ExecutionSettings:
        """Return these settings for one plan on its own, which no other look follows.

        Args:
            most_speed: greatest permitted share of the planned speed.
            attended: whether an operator is at the controls.
            dead_man: whether motion requires the dead-man key.
        """
        return replace(
            self,
            most_speed=most_speed,
            attended=attended,
            dead_man=dead_man,
            lost_cloth=LostCloth.STOP,
            leave_mode=True,
        )

    def at_rest(self, feedback: ExecutionFeedback) -> bool:
        """Return whether every axis is known to be at rest."""
        known = feedback.age <= self.settle
        return known and bool(np.abs(feedback.velocities).max() <= self.rest_speed)

    def at(self, feedback: ExecutionFeedback, positions: Array) -> bool:
        """Return whether every axis is at a point (A,), rad."""
        off = np.abs(feedback.positions - positions)
        return bool((off <= self.position_tolerance).all())

    def check_speed(self, speed: float) -> None:
        """Refuse a share of the planned speed.

        Raises:
            InputError: it is not above 0, or above `most_speed`.
        """
        if not 0.0 < speed <= 1.0:
            raise InputError(f"the speed is {speed:g}; give a fraction above 0, up to 1")
        if speed > self.most_speed + 1e-9:
            raise InputError(
                f"the speed is {speed:g}, above the {self.most_speed:g} that this execution allows"
            )
