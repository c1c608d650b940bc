"""Acceptance checks of a calibration, and detection of outlying views."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.errors import InputError
from unwrinkle.perception.calibration.boards import BoardView

#: Least number of views.
FEWEST_VIEWS = 8

#: Largest RMS reprojection error, pixels.
MOST_RESIDUAL = 1.0

#: Largest fraction of rejected views.
_MAX_REJECTED_FRACTION = 0.34

#: RMS error of an outlying view, multiples of the median view's.
_OUTLIER_RATIO = 3.0

#: Least RMS error of an outlying view, pixels.
_MIN_OUTLIER_PX = 0.25

#: Largest relative standard deviation of the focal length.
_MAX_FOCAL_SIGMA = 0.01

#: Least range of the boards' tilts about either axis, radians.
_MIN_TILT_RAD = np.radians(12.0)

#: Limit of the rejected views listed in a message.
_MAX_LISTED = 3


def worst_outlier(rms: NDArray[np.float64]) -> int | None:
    """Return the index of the view with the largest error if it is an outlier, else None."""
    worst = int(np.argmax(rms))
    limit = max(_MIN_OUTLIER_PX, _OUTLIER_RATIO * float(np.median(rms)))
    return worst if rms[worst] > limit else None


def check_residual(rms: float, name: str) -> None:
    """Check the RMS reprojection error of a fit.

    Raises:
        InputError: the RMS reprojection error is over 1 px.
    """
    if not rms <= MOST_RESIDUAL:
        raise InputError(
            f"{name}: the corners fit to {rms:.2f} px only, wanted {MOST_RESIDUAL:.1f} or less; is "
            "the board flat, its size right, and nothing moved while a picture was taken?"
        )


def check_rejected(kept: int, rejected: list[str]) -> None:
    """Check that at most a third of the views are rejected.

    Raises:
        InputError: too many are rejected; the message lists them.
    """
    if len(rejected) > _MAX_REJECTED_FRACTION * (kept + len(rejected)):
        raise InputError(
            f"calibration: {len(rejected)} of {kept + len(rejected)} views do not fit, at most a "
            f"third may be left out{listed(rejected)}; check board, order and angles"
        )


def listed(rejected: Sequence[str]) -> str:
    """Format the first rejections for a message; empty without any."""
    if not rejected:
        return ""
    more = f"; {len(rejected) - _MAX_LISTED} more" if len(rejected) > _MAX_LISTED else ""
    return f" (left out: {'; '.join(rejected[:_MAX_LISTED])}{more})"


def check_sizes(views: list[BoardView], name: str) -> None:
    """Check that all images of a camera have one size.

    Raises:
        InputError: they differ; the message names one image of each size.
    """
    sizes: dict[tuple[int, int], str] = {}
    for view in views:
        sizes.setdefault((view.width, view.height), view.name)
    if len(sizes) > 1:
        found = ", ".join(f"{view} {w} x {h}" for (w, h), view in sizes.items())
        raise InputError(
            f"calibration: {name} images have different sizes ({found}); one camera has one size"
        )


def check_count(count: int, rejected: list[str]) -> None:
    """Check that there are at least 8 views.

    Raises:
        InputError: there are fewer; the message lists the rejected ones.
    """
    if count < FEWEST_VIEWS:
        raise InputError(
            f"calibration: {count} usable views, wanted at least {FEWEST_VIEWS}{listed(rejected)}; "
            "take more, the board tilted and placed differently in each"
        )


def check_focal(name: str, loose: float) -> None:
    """Check that the relative standard deviation of the focal length is at most 1 %.

    Raises:
        InputError: it is larger.
    """
    if not loose <= _MAX_FOCAL_SIGMA:
        raise InputError(
            f"{name} camera: the views leave its focal length open by {loose:.1%}, wanted "
            f"{_MAX_FOCAL_SIGMA:.0%} or less; tilt the board by 20 to 40 degrees about two axes, "
            "and fill more of the image"
        )


def check_tilts(turns: NDArray[np.float64], name: str) -> None:
    """Check that the boards are tilted about two axes, which the focal length requires.

    Args:
        turns: (n, 3) rotation vectors of the boards in the camera's frame.
        name: of the camera.

    Raises:
        InputError: the boards' normals vary too little along a principal direction.
    """
    normals = Rotation.from_rotvec(turns).as_matrix()[:, :2, 2]
    _, _, axes = np.linalg.svd(normals - normals.mean(axis=0))
    most, least = sorted(np.ptp(normals @ axes.T, axis=0), reverse=True)
    if least < _MIN_TILT_RAD:
        raise InputError(
            f"{name} camera: the board is tilted by {np.degrees(most):.0f} degrees about one axis "
            f"and by {np.degrees(least):.0f} about the other, wanted at least "
            f"{np.degrees(_MIN_TILT_RAD):.0f} about both; tilt it more, by 20 to 40 degrees"
        )
