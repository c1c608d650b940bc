"""Which wrinkle comes first. Pure functions of values.

- `volume`: the largest by Eq. 4, the published rule.
- `pull`, `height`, `length`: the one that asks for the longest pull, stands highest, or is longest.
- `together`: the one whose section, along which the hands pull, crosses most of all wrinkles: the sum over those that
  it crosses of the volume times cos^2 of the angle between the section and the way across that wrinkle. A pull along the
  section takes slack out of all of these at once.
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
    """Wrinkles as they come, first the one with the most of what `order` names; alike ones stay as they were.

    Args:
        wrinkles: each with an attribute for every one of ORDERS, see `judgement.WrinkleFeatures`.
        order: one of ORDERS.

    Raises:
        InputError: an unknown order.
    """
    if order not in ORDERS:
        raise InputError(f"order {order!r}: must be one of {', '.join(ORDERS)}")
    return sorted(wrinkles, key=attrgetter(order), reverse=True)


def highest_part(wrinkle: Wrinkle) -> float:
    """Height of the highest part of a ridge over its feet, m: a wrinkle that runs out to the rim is highest there."""
    crest = wrinkle.crests[:, 2]
    return wrinkle.peak_height + float(np.percentile(crest, HIGHEST) - np.median(crest))


def flattened_together(wrinkles: Sequence[Wrinkle], section: str = "centre") -> list[float]:
    """Volume, mm^3, of all wrinkles that a pull across each wrinkle works on, times cos^2 of the angle.

    Args:
        wrinkles: any.
        section: where the section goes, see `targeting.section_place`.
    """
    volumes = np.exp([wrinkle.volume_score for wrinkle in wrinkles])
    return [
        float(volumes @ [_share(wrinkle, other, section) for other in wrinkles])
        for wrinkle in wrinkles
    ]


def _share(pulled: Wrinkle, other: Wrinkle, section: str) -> float:
    """cos^2 of the angle between a wrinkle's section and the way across another; 0 if it does not cross it."""
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
