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


class InsufficientViewError(PerceptionError):
    """Too little of the table or of the garment was measured."""


class EpipolarError(PerceptionError):
    """The two images of a stereo pair do not agree with the stated geometry."""


class NoSafePlanError(UnwrinkleError):
    """No motion that passes every check exists for what was asked."""

    exit_code = 3


class HardwareError(UnwrinkleError):
    """A device that does not answer, refuses, or answers what cannot be: nothing more is sent to it."""

    exit_code = 4
