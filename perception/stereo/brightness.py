"""Brightness of the eyes: gain, offset and gamma between two images of one scene.

With automatic exposure the two cameras of a head store the same table at different grey levels. The
matcher takes out an offset, no factor. The eyes see nearly the same surfaces, so the quantiles of
their grey levels belong together, and a smooth curve through them maps one onto the other.
"""

import logging
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError

_log = logging.getLogger(__name__)

#: Quantiles that are compared; the tails belong to what only one eye sees.
_QUANTILES = np.linspace(0.04, 0.96, 47)

#: Grey levels outside which a quantile is clipped by a camera.
_DARKEST, _BRIGHTEST = 3.0, 250.0

#: Exponents that are tried. The first is that of equal cameras.
_GAMMAS = (1.0, *np.geomspace(0.45, 2.2, 23))

#: Least number of quantiles, and least range of grey levels, for a curve.
_MIN_QUANTILES = 12
_MIN_RANGE = 8.0

#: RMS difference of the quantiles, grey levels, and ratio of brightness less 1, up to which the
#: images are left as they are: the eyes see a little different parts of the scene.
_EQUAL = 6.0
_EQUAL_RATIO = 0.05

#: Largest ratio of the eyes' brightness that is compensated: noise and steps grow with it.
_MAX_RATIO = 2.2

#: Largest RMS of the quantiles about the curve, grey levels.
_MAX_RESIDUAL = 6.0

#: Improvement of the residual, ratio, that an exponent other than 1 needs.
_GAMMA_GAIN = 0.8

_CURE = "set both to the same exposure, gain and gamma, without automatic control"


def check_exposures(left: NDArray[np.uint8], right: NDArray[np.uint8], name: str) -> None:
    """Refuse two grey images whose brightness differs too much for their features to match.

    Args:
        left, right: (h, w) grey images of the eyes, as taken.
        name: of the pair, for messages.

    Raises:
        InputError: one is more than 2.2 times as bright as the other.
    """
    step = max(1, left.shape[1] // 500)
    dark, bright = (float(np.median(image[::step, ::step])) for image in (right, left))
    ratio = max(1.0, bright) / max(1.0, dark)
    if not 1.0 / _MAX_RATIO <= ratio <= _MAX_RATIO:
        _refuse_ratio(ratio, name)


def _refuse_ratio(ratio: float, name: str) -> NoReturn:
    raise InputError(
        f"{name}: the left eye's image is {ratio:.2f} times as bright as the right one's, at "
        f"most {_MAX_RATIO} or {1.0 / _MAX_RATIO:.2f} is compensated; {_CURE}"
    )


def equalized(left: NDArray[np.uint8], right: NDArray[np.uint8], name: str) -> NDArray[np.uint8]:
    """Return the right image with the brightness of the left one.

    Args:
        left, right: (h, w) rectified grey images; 0 outside a camera's view.
        name: of the pair, for messages.

    Raises:
        InputError: the eyes' exposures differ too much, or no gain, offset and gamma explain it.
    """
    step = max(1, left.shape[1] // 1000)
    a, b = left[::step, ::step], right[::step, ::step]
    a, b = a[a > 0], b[b > 0]
    if min(a.size, b.size) < 1000:
        return right
    wanted, given = np.quantile(a, _QUANTILES), np.quantile(b, _QUANTILES)
    ratio = float(np.median(wanted) / max(1.0, float(np.median(given))))
    apart = float(np.sqrt(np.mean((wanted - given) ** 2)))
    if apart <= _EQUAL and abs(ratio - 1.0) <= _EQUAL_RATIO:
        return right
    inside = (np.minimum(wanted, given) >= _DARKEST) & (np.maximum(wanted, given) <= _BRIGHTEST)
    if not 1.0 / _MAX_RATIO <= ratio <= _MAX_RATIO:
        _refuse_ratio(ratio, name)
    if np.count_nonzero(inside) < _MIN_QUANTILES or np.ptp(given[inside]) < _MIN_RANGE:
        raise InputError(
            f"{name}: the eyes' brightness differs ({ratio:.2f} times) and too little of the "
            f"images is exposed well to compensate it; {_CURE}"
        )
    gamma, gain, offset, residual = _curve(wanted[inside], given[inside])
    if residual > _MAX_RESIDUAL or gain <= 0.0:
        raise InputError(
            f"{name}: the eyes' brightness differs ({ratio:.2f} times) in a way that no gain, "
            f"offset and gamma explain ({residual:.0f} grey levels are left); {_CURE}"
        )
    _log.warning(
        "%s: the left eye's image is %.2f times as bright as the right one's; compensated (gain "
        "%.2f, offset %.0f, gamma %.2f); %s",
        name,
        ratio,
        gain,
        offset,
        gamma,
        _CURE,
    )
    levels = 255.0 * (np.arange(256.0) / 255.0) ** gamma
    table = np.clip(np.rint(gain * levels + offset), 1.0, 255.0).astype(np.uint8)
    table[0] = 0  # outside the view
    return table[right]


def _curve(
    wanted: NDArray[np.float64], given: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """Return gamma, gain, offset and the RMS residual, grey levels, of the best curve."""
    fits = []
    for gamma in _GAMMAS:
        levels = 255.0 * (given / 255.0) ** gamma
        basis = np.column_stack([levels, np.ones(levels.size)])
        (gain, offset), *_ = np.linalg.lstsq(basis, wanted, rcond=None)
        rest = basis @ [gain, offset] - wanted
        fits.append((float(gamma), float(gain), float(offset), float(np.sqrt(np.mean(rest**2)))))
    plain, best = fits[0], min(fits, key=lambda fit: fit[3])
    return best if best[3] < _GAMMA_GAIN * plain[3] else plain
