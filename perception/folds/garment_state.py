"""The state of a garment: flat, wrinkled, folded or crumpled, or not seen well enough.

Without the garment's flat area, a coarse sensor cannot tell deep wrinkles from folds; then the
state says so: not flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from unwrinkle.models.garment import KnownGarment
from unwrinkle.perception.folds.borders import Borders, find_borders
from unwrinkle.perception.folds.flaps import Flap, flaps_by_borders, flaps_by_outline
from unwrinkle.perception.folds.height_image import HeightImage, Points, height_image
from unwrinkle.perception.folds.ridge_kinds import RidgeKind, ridge_kind
from unwrinkle.perception.folds.settings import FoldSettings, fold_settings
from unwrinkle.perception.layer_mask import LayerMask
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle

#: Least area of what is seen, of the flat area; below it the mask is not the garment.
_LEAST_SEEN_AREA = 0.13

#: Largest share of the garment without readings: for any answer, and for "flat".
_MOST_UNSEEN = 0.5
_MOST_UNSEEN_FLAT = 0.1

#: A coarse sensor's mask by depth alone is whole if the flat cloth stands this multiple of the
#: sensor's least height of a garment above the table.
_CLEAR_OF_TABLE = 1.2

#: Least area seen from above of a flat garment, of its flat area.
_LEAST_FLAT_AREA = 0.97

#: Largest area that a garment can show, of its flat area; above it the mask is more than it.
_MOST_SEEN_AREA = 1.08


class GarmentState(StrEnum):
    """What a garment on the table is."""

    FLAT = "flat"
    WRINKLED = "wrinkled"
    FOLDED = "folded or crumpled"
    NOT_FLAT = "not flat: wrinkled or folded"
    UNSEEN = "not seen well enough"


@dataclass(frozen=True, eq=False)
class FoldAnalysis:
    """Layers and folds of a garment, and its state by them; wrinkles worth pulling come on top.

    Attributes:
        state: of the garment. `FLAT` and `WRINKLED` say that no layer lies on another.
        reasons: why, in words.
        relief: height of the highest cloth (99.5 % quantile) over the lowest (20 %), metres.
        surface_area: of the visible surface in space, m^2.
        hidden: share of the flat area that is hidden below other cloth; None if that is not known.
        borders: of layers, lines (k, 2) in the world, metres.
        border_length: of all of them, metres.
        flaps: found, largest first.
        kinds: what each ridge of the analysis is, in its order.
        layers: cells under the flaps.
    """

    state: GarmentState
    reasons: tuple[str, ...]
    relief: float
    surface_area: float
    hidden: float | None
    borders: tuple[Points, ...]
    border_length: float
    flaps: tuple[Flap, ...]
    kinds: tuple[RidgeKind, ...]
    layers: LayerMask

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {
            "state": self.state.value,
            "reasons": list(self.reasons),
            "relief": self.relief,
            "surface_area": self.surface_area,
            "hidden_share": self.hidden,
            "border_length": self.border_length,
            "borders": [line.round(4).tolist() for line in self.borders],
            "flaps": [flap.to_json() for flap in self.flaps],
        }


def analyse_folds(
    range_map: RangeMap,
    wrinkles: tuple[Wrinkle, ...],
    profile: NoiseProfile,
    known: KnownGarment | None = None,
) -> FoldAnalysis:
    """Find borders of layers and flaps, and say what state a garment is in.

    Args:
        range_map: height above the table, with the garment's mask.
        wrinkles: found on it.
        profile: of the sensor's noise.
        known: the garment as it is when flat; without it layers are found by their borders alone.

    Raises:
        InputError: no garment on the range map, or nothing of it was measured.
    """
    settings = fold_settings(profile)
    image = height_image(range_map, settings.cell)
    z = image.smoothed(settings.level_smoothing)[image.garment]
    low, high = (float(value) for value in np.percentile(z, (20.0, 99.5)))
    relief, surface_area = high - low, image.surface_area(settings.smoothing)
    borders = find_borders(image, settings)
    hidden = None if known is None else 1.0 - surface_area / known.flat_area
    flaps = _flaps(image, settings, borders, known, hidden)
    state, reasons = _state(image, settings, known, relief, hidden, borders, flaps)
    if state is GarmentState.FLAT and known is None and _guessed(range_map, profile, low):
        state = GarmentState.UNSEEN
        reason = (
            "looks flat, but it was told from the table by depth alone, which does not show the "
            f"flat parts of cloth thinner than {1e3 * profile.garment_height:.0f} mm; add colour, "
            "or the garment's flat area"
        )
        reasons = (reason,)
    kinds = tuple(ridge_kind(image, settings, wrinkle) for wrinkle in wrinkles)
    layers = np.zeros(image.garment.shape, dtype=bool)
    for flap in flaps:
        layers |= flap.region
    lines = tuple(image.world(line) for line in borders.lines())
    return FoldAnalysis(
        state,
        reasons,
        relief,
        surface_area,
        hidden,
        lines,
        borders.length,
        tuple(flaps),
        kinds,
        LayerMask(layers, image.origin, image.resolution),
    )


def _guessed(range_map: RangeMap, profile: NoiseProfile, level: float) -> bool:
    """Whether flat parts of a garment at a level, metres, may be missing from its mask."""
    blind = fold_settings(profile).fine is False and range_map.mask_by == "depth"
    return blind and level < _CLEAR_OF_TABLE * profile.garment_height


def _flaps(
    image: HeightImage,
    settings: FoldSettings,
    borders: Borders,
    known: KnownGarment | None,
    hidden: float | None,
) -> list[Flap]:
    flaps: list[Flap] = []
    if known is not None and known.outline and hidden is not None:
        flaps = flaps_by_outline(image, settings, known, hidden * known.flat_area)
    elif borders.length >= settings.least_border_length:
        flaps = flaps_by_borders(image, settings, borders)
    return sorted(flaps, key=lambda flap: -flap.area)


def _state(
    image: HeightImage,
    settings: FoldSettings,
    known: KnownGarment | None,
    relief: float,
    hidden: float | None,
    borders: Borders,
    flaps: list[Flap],
) -> tuple[GarmentState, tuple[str, ...]]:
    if image.unseen > _MOST_UNSEEN:
        return GarmentState.UNSEEN, (f"{image.unseen:.0%} of the garment has no readings",)
    if known is not None:
        seen = image.area / known.flat_area
        if seen < _LEAST_SEEN_AREA:
            reason = f"{seen:.0%} of the {known.name}'s flat area was found; the rest may be hidden"
            return GarmentState.UNSEEN, (reason,)
        if seen > _MOST_SEEN_AREA:
            reason = f"what was found is {seen:.0%} of the {known.name}'s flat area: more than it"
            return GarmentState.UNSEEN, (reason,)
    folded = _folded(settings, hidden, borders, flaps, known)
    if folded:
        told = settings.fine or known is not None or bool(flaps)
        return GarmentState.FOLDED if told else GarmentState.NOT_FLAT, tuple(folded)
    wrinkled = []
    if relief > settings.most_relief:
        wrinkled.append(
            f"stands {1e3 * relief:.1f} mm above its lowest cloth, at most "
            f"{1e3 * settings.most_relief:.1f} mm is flat"
        )
    if known is not None and image.area < _LEAST_FLAT_AREA * known.flat_area:
        wrinkled.append(f"covers {image.area / known.flat_area:.1%} of its flat area")
    if wrinkled:
        told = settings.fine or known is not None
        return GarmentState.WRINKLED if told else GarmentState.NOT_FLAT, tuple(wrinkled)
    if image.unseen > _MOST_UNSEEN_FLAT:
        return GarmentState.UNSEEN, (
            f"looks flat, but {image.unseen:.0%} of the garment has no readings",
        )
    return GarmentState.FLAT, (f"stands at most {1e3 * relief:.1f} mm above its lowest cloth",)


def _folded(
    settings: FoldSettings,
    hidden: float | None,
    borders: Borders,
    flaps: list[Flap],
    known: KnownGarment | None,
) -> list[str]:
    """Return the reasons why layers must lie on each other."""
    reasons = []
    if hidden is not None and 1.0 - hidden < settings.least_area_share:
        reasons.append(f"{hidden:.1%} of the cloth is hidden below other cloth")
    if flaps:
        areas = ", ".join(f"{1e4 * flap.area:.0f} cm2" for flap in flaps)
        count = "a flap" if len(flaps) == 1 else f"{len(flaps)} flaps"
        reasons.append(f"{count} of {areas} folded over")
    if known is None and borders.length >= settings.least_border_length:
        reasons.append(f"borders of layers of {1e3 * borders.length:.0f} mm in all")
    return reasons
