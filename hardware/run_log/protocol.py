"""What a driver tells a log: the interface alone, so that a driver needs no file."""

from typing import Any, Protocol

from numpy.typing import ArrayLike

from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback


class RunLogger(Protocol):
    """Takes down what happens, in order; every method raises OSError where it cannot be written."""

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        """A point that was sent to the controller.

        Args:
            now: the driver's clock, s.
            number: of the command whose trajectory it belongs to.
            sequence: of the point in the trajectory.
            time: of the point on the controller's trajectory clock, s.
            positions: (13,) rad.
            velocities: (13,) rad/s.

        Raises:
            OSError: it cannot be written.
        """
        ...

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """A whole set of joint feedback.

        Raises:
            OSError: it cannot be written.
        """
        ...

    def status(self, now: float, status: DriverStatus) -> None:
        """The driver's status, where it has changed.

        Raises:
            OSError: it cannot be written.
        """
        ...

    def event(self, now: float, kind: str, text: str, **data: Any) -> None:
        """Something that happened once.

        Args:
            now: the driver's clock, s.
            kind: one word: connect, run, hold, resume, stop, fault, gripper, ...
            text: a sentence for the user.
            data: plain values that belong to it.

        Raises:
            OSError: it cannot be written.
        """
        ...


class NoLog:
    """Takes nothing down."""

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        """Forget it."""

    def measured(self, now: float, feedback: JointFeedback) -> None:
        """Forget it."""

    def status(self, now: float, status: DriverStatus) -> None:
        """Forget it."""

    def event(self, now: float, kind: str, text: str, **data: Any) -> None:
        """Forget it."""
