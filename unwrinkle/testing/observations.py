"""Observations with features of one's choice, made without pictures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from unwrinkle.flattening.observation import GarmentFeatures, Observation, WrinkleFeatures
from unwrinkle.perception.folds.garment_state import analyse_folds
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.target import FlatteningTarget, NoTarget
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.perception.wrinkles.surface import Surface, fit_surface
from unwrinkle.planning.plan import GarmentSurface
from unwrinkle.simulation.rendering.synthetic_towel import Towel
from unwrinkle.testing.table import TABLE
from unwrinkle.testing.targets import flattening_task
from unwrinkle.testing.towels import map_of

#: Where the towel lies, world x and y, m.
TOWEL_CENTRE = (0.05, -1.15)
_RESOLUTION = 0.005  # m
_HALTING_PULL = 0.005  # m
_NOISE = 0.0003  # m


@dataclass(frozen=True)
class SeenWrinkle:
    """A wrinkle across the robot's forward direction.

    Attributes:
        place: of its centre along x, m.
        volume_score: of Eq. 4.
        pull: pull distance, m.
        height: m.
    """

    place: float
    volume_score: float
    pull: float
    height: float

    @property
    def target(self) -> FlatteningTarget:
        """The target that is found for it."""
        return flattening_task((self.place, -1.1), 0.0, half=0.2, pull=0.02)


@dataclass(frozen=True, eq=False)
class _Chosen(Analysis):
    """An analysis whose targets were chosen."""

    targets: Sequence[FlatteningTarget | NoTarget] = ()

    def target_for(self, index: int) -> FlatteningTarget | NoTarget:
        """Return the target of a wrinkle."""
        return self.targets[index]


@dataclass(frozen=True, eq=False)
class _Plain(Observation):
    """An observation whose garment is not drawn."""

    def garment(self, wrinkle: int) -> GarmentSurface | None:
        """Return none."""
        return None


@cache
def flat_towel_map() -> RangeMap:
    """Return a coarse map of a flat towel on the table, without noise."""
    return map_of(Towel(ridges=(), centre=TOWEL_CENTRE), _RESOLUTION, noise=0.0)


@cache
def _surface() -> Surface:
    return fit_surface(flat_towel_map(), noise_profile("stereo"))


def observation_of(
    wrinkles: Sequence[SeenWrinkle], targets: Mapping[int, NoTarget] | None = None
) -> Observation:
    """Make an observation in which a garment has these wrinkles.

    Args:
        wrinkles: largest first.
        targets: for wrinkles, by index, that have none; the others have their own.
    """
    features = tuple(
        WrinkleFeatures(
            index,
            (each.place, -1.1),
            0.0,
            math.exp(each.volume_score),
            each.pull,
            each.height,
            0.1,
            1.0,
        )
        for index, each in enumerate(wrinkles)
    )
    range_map, profile = flat_towel_map(), noise_profile("stereo")
    chosen: list[FlatteningTarget | NoTarget] = [each.target for each in wrinkles]
    for index, none in (targets or {}).items():
        chosen[index] = none
    analysis = _Chosen(
        range_map=range_map,
        profile=profile,
        mode="foot",
        surface=_surface(),
        ridge_points=np.zeros((1, 1), dtype=bool),
        wrinkles=(),
        table=TABLE,
        targets=chosen,
    )
    folds = analyse_folds(range_map, (), profile)
    return _Plain(analysis, folds, GarmentFeatures(features, _HALTING_PULL, _NOISE))
