"""Interface of a run log, so that a driver does not depend on a file."""

from typing import Any, Protocol

from numpy.typing import ArrayLike

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback


class RunLogger(Protocol):
    """Records events in order."""

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        """Record a point that was sent to the controller.

        Args:
            now: the driver's clock, s.
            number: of the command whose trajectory the point belongs to.
            sequence: of the point in the trajectory.
            time: of the point on the controller's trajectory clock, s.
            positions: (13,) rad.
            velocities: (13,) rad/s.

        Raises:
            OSError: the log cannot be written.
        """
        ...

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """Record a complete set of joint feedback.

        Raises:
            OSError: the log cannot be written.
        """
        ...

    def status(self, now: float, status: DriverStatus) -> None:
        """Record the driver's status after a change.

        Raises:
            OSError: the log cannot be written.
        """
        ...

    def event(self, now: float, kind: str, text: str, **data: Any) -> None:
        """Record a single event.

        Args:
            now: the driver's clock, s.
            kind: one word: connect, run, hold, resume, stop, fault, gripper, ...
            text: a sentence for the user.
            data: plain values of the event.

        Raises:
            OSError: the log cannot be written.
        """
        ...


class NoLog:
    """Records nothing."""

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        """Do nothing."""

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """Do nothing."""

    def status(self, now: float, status: DriverStatus) -> None:
        """Do nothing."""

    def event(self, now: float, kind: str, text: str, **data: Any) -> None:
        """Do nothing."""
