"""The exception tree of the project. A message says what, where, by how much, and what to try."""


class UnwrinkleError(Exception):
    """Base of every exception this project raises on purpose.

    Attributes:
        exit_code: what the command line returns when this error ends it.
    """

    exit_code = 1


class InputError(UnwrinkleError):
    """A file, an option or an array that cannot be used: wrong shape, truncated, unknown key."""

    exit_code = 2


class PerceptionError(InputError):
    """The images or the depth are readable but do not yield the measurement that was asked for."""


class NoGarmentError(PerceptionError):
    """The table was seen and nothing on it stands out as a garment."""


class SeveralGarmentsError(PerceptionError):
    """More than one thing on the table may be the garment."""


class InsufficientViewError(PerceptionError):
    """Too little of the table or of the garment was measured."""


class EpipolarError(PerceptionError):
    """The two images of a stereo pair do not agree with the stated geometry."""


class NoVerifiedPlanError(UnwrinkleError):
    """No motion that passes every check exists for what was asked."""

    exit_code = 3


class HardwareError(UnwrinkleError):
    """A device that does not answer, refuses, or answers what cannot be: nothing more is sent to
    it.
    """

    exit_code = 4


class ConnectionLostError(HardwareError):
    """A connection to a device that cannot be made, or that has ended."""


class ProtocolError(HardwareError):
    """Bytes or replies that a device's protocol does not permit."""


class OverdueError(HardwareError):
    """A device that has not answered in time.

    Attributes:
        waited: since the request, s.
        allowed: at most, s.
    """

    def __init__(self, text: str, waited: float, allowed: float) -> None:
        """State the request that is not answered."""
        super().__init__(text)
        self.waited = waited
        self.allowed = allowed

    def __reduce__(self) -> tuple[type["OverdueError"], tuple[str, float, float]]:
        """Pickle with all data."""
        return type(self), (str(self), self.waited, self.allowed)


class InUseError(HardwareError):
    """A device that another program commands.

    Attributes:
        owner: that program, for the user.
    """

    def __init__(self, text: str, owner: str) -> None:
        """State which device is in use, and by whom."""
        super().__init__(text)
        self.owner = owner

    def __reduce__(self) -> tuple[type["InUseError"], tuple[str, str]]:
        """Pickle with all data."""
        return type(self), (str(self), self.owner)
