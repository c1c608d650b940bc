"""Order of wrinkles. Pure functions of values.

- `volume`: largest volume first (Eq. 4), the published rule.
- `pull`, `height`, `length`: longest pull distance, greatest height, or greatest length first.
- `together`: first the wrinkle whose section, along which the hands pull, crosses the most volume:
  the sum over all wrinkles that it crosses of the volume times cos^2 of the angle between the
  section and the direction across that wrinkle. A pull along the section removes slack from all of
  them at once.
"""

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import TypeVar

import numpy as np

from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import ORDERS
from unwrinkle.perception.wrinkles.targeting import section_place, section_start
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle

_Seen = TypeVar("_Seen")

#: Percentile of a ridge's crest that counts as its highest part.
HIGHEST = 95.0


def in_order(wrinkles: Iterable[_Seen], order: str) -> list[_Seen]:
    """Sort wrinkles, first the one with the greatest value of `order`; equal ones keep their order.

    Args:
        wrinkles: each with an attribute for every one of ORDERS, see `observation.WrinkleFeatures`.
        order: one of ORDERS.

    Raises:
        InputError: an unknown order.
    """
    if order not in ORDERS:
        raise InputError(f"order {order!r}: must be one of {', '.join(ORDERS)}")
    return sorted(wrinkles, key=attrgetter(order), reverse=True)


def highest_part(wrinkle: Wrinkle) -> float:
    """Return the height of the highest part of a ridge above its feet, m.

    A wrinkle that reaches the rim is highest there.
    """
    crest = wrinkle.crests[:, 2]
    return wrinkle.peak_height + float(np.percentile(crest, HIGHEST) - np.median(crest))


def flattened_together(wrinkles: Sequence[Wrinkle], section: str = "centre") -> list[float]:
    """Return, for each wrinkle, the volume of all wrinkles that a pull across it flattens, mm^3.

    Args:
        wrinkles: of one garment.
        section: place of the section, see `targeting.section_place`.

    Returns:
        Volumes, each times cos^2 of the angle between the section and the direction across that
        wrinkle.
    """
    volumes = np.exp([wrinkle.volume_score for wrinkle in wrinkles])
    return [
        float(volumes @ [_share(wrinkle, other, section) for other in wrinkles])
        for wrinkle in wrinkles
    ]


def _share(pulled: Wrinkle, other: Wrinkle, section: str) -> float:
    """Return cos^2 of the angle between a wrinkle's section and the direction across another.

    0 if they do not cross.
    """
    if other is pulled:
        return 1.0
    start = section_start(pulled, section_place(pulled, section))[:2]
    aside = (other.curve[:, :2] - start) @ pulled.direction
    crossed = np.flatnonzero((aside[1:] > 0.0) != (aside[:-1] > 0.0))
    if len(crossed) == 0:
        return 0.0
    along = other.curve[crossed + 1, :2] - other.curve[crossed, :2]
    along /= np.hypot(*along.T)[:, None]
    return float(np.max((along @ pulled.direction) ** 2))
