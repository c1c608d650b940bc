"""Wrinkle analysis: from a range map to measured wrinkles and a flattening target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unwrinkle.models.choices import PullReading
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.perception.layer_mask import LayerMask
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile, noise_profile
from unwrinkle.perception.target import FlatteningTarget, NoTarget
from unwrinkle.perception.wrinkles.ridges import contour_points, link, ridge_points
from unwrinkle.perception.wrinkles.surface import Surface, fit_surface, spread
from unwrinkle.perception.wrinkles.targeting import flattening_target
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle, wrinkles_of
from unwrinkle.perception.wrinkles.wrinkledness import Wrinkledness, wrinkledness

#: Distance from the table's edge within which the garment's outline counts as along it, metres.
#: Range maps may lack a rim of this width.
_AT_EDGE = 0.012


@dataclass(frozen=True, eq=False)
class Analysis:
    """Wrinkles found on a range map, with the intermediate results.

    Attributes:
        range_map: the analysed range map.
        profile: noise profile used.
        mode: one of `PullReading`, the reading of Eq. 5.
        surface: the garment's fitted surface, on its own grid.
        ridge_points: mask of ridge points, on the surface's grid.
        wrinkles: sorted by volume score, largest first.
        table: the working table; grasp points stay on it.
        section, pull, opening, layers: options of the targets, see `flattening_target`.
    """

    range_map: RangeMap
    profile: NoiseProfile
    mode: str
    surface: Surface
    ridge_points: NDArray[np.bool_]
    wrinkles: tuple[Wrinkle, ...]
    table: Table
    section: str = "centre"
    pull: str = "wrinkle"
    opening: float = inf
    layers: LayerMask | None = None

    @property
    def halting_measure(self) -> float:
        """Largest pull distance (Eq. 5, reading `mode`) of a wrinkle, metres; 0 without any."""
        return max((w.pull_distance(self.mode) for w in self.wrinkles), default=0.0)

    @property
    def share_beyond_table(self) -> float:
        """Fraction of the garment's area that lies beyond the table's edges."""
        rows, columns = np.nonzero(self.range_map.garment)
        points = self.range_map.origin + self.range_map.resolution * np.column_stack(
            [columns, rows]
        )
        beyond = self.table.outside(points)
        return float(beyond.mean()) if len(beyond) else 0.0

    @property
    def share_along_edge(self) -> float:
        """Fraction of the garment's outline along the table's edges, where cloth may hang over."""
        mask = self.range_map.garment
        inner = ndimage.binary_erosion(mask)
        rows, columns = np.nonzero(mask & ~inner)
        points = self.range_map.origin + self.range_map.resolution * np.column_stack(
            [columns, rows]
        )
        along = self.table.outside(points, _AT_EDGE)
        return float(along.mean()) if len(along) else 0.0

    @cached_property
    def classes(self) -> NDArray[np.uint8]:
        """Shape classes resampled to the range map's grid, uint8; 0 for flat and outside."""
        return spread(self.surface.classes, self.surface, self.range_map)

    @cached_property
    def ridges(self) -> NDArray[np.bool_]:
        """Ridge-point mask resampled to the range map's grid."""
        return spread(self.ridge_points, self.surface, self.range_map)

    @cached_property
    def contours(self) -> NDArray[np.bool_]:
        """Inflection-contour mask resampled to the range map's grid."""
        return spread(contour_points(self.surface), self.surface, self.range_map)

    @cached_property
    def surface_height(self) -> NDArray[np.float32]:
        """Height of the fitted surface on the range map's grid, metres above the table."""
        return spread(self.surface.z, self.surface, self.range_map)

    @cached_property
    def wrinkledness(self) -> Wrinkledness:
        """Entropy of the surface normals and the grasp point with the highest score."""
        return wrinkledness(self.surface, self.profile)

    def target_for(self, index: int) -> FlatteningTarget | NoTarget:
        """Compute the flattening target of wrinkle `index`, whatever its size.

        Raises:
            InputError: there is no such wrinkle.
        """
        if not 0 <= index < len(self.wrinkles):
            raise InputError(f"wrinkle {index}: there are {len(self.wrinkles)} wrinkles")
        return flattening_target(
            self.range_map,
            self.surface,
            self.wrinkles[index],
            mode=self.mode,
            section=self.section,
            pull=self.pull,
            table=self.table,
            opening=self.opening,
            layers=self.layers,
        )

    def to_json(self, *, points: bool = False) -> dict[str, Any]:
        """Return the result as plain data; with `points`, also the wrinkles' point lists."""
        return {
            "format": "unwrinkle.analysis",
            "version": 1,
            "sensor": self.range_map.sensor,
            "resolution": self.range_map.resolution,
            "shape": list(self.range_map.shape),
            "mode": self.mode,
            "halting_pull": self.profile.halting_pull,
            "halting_measure": self.halting_measure,
            "wrinkles": [wrinkle.to_json(points=points) for wrinkle in self.wrinkles],
        }


def analyse(
    range_map: RangeMap,
    *,
    table: Table,
    mode: str = "foot",
    profile: NoiseProfile | None = None,
    patches: bool = False,
    section: str = "centre",
    pull: str = "wrinkle",
    opening: float = inf,
) -> Analysis:
    """Find the wrinkles on a range map and the target of the largest that can be grasped.

    Args:
        range_map: height above the table, with the garment's mask.
        table: the working table; grasp points stay on it.
        mode: reading of Eq. 5, see `PullReading`.
        profile: noise profile; None for that of the range map's sensor.
        patches: fit the paper's independent surface patches instead of one smooth surface.
        section, pull, opening: options of the targets, see `flattening_target`.

    Raises:
        InputError: unknown mode or sensor, no garment, or no measured cell on it.
    """
    mode = PullReading(mode).value
    profile = profile or noise_profile(range_map.sensor)
    surface = fit_surface(range_map, profile, patches=patches)
    ridge = ridge_points(surface, profile)
    wrinkles = [
        wrinkle
        for line in link(ridge, surface, profile)
        for wrinkle in wrinkles_of(line, surface, profile, range_map.table_height)
    ]
    wrinkles.sort(key=lambda wrinkle: -wrinkle.volume_score)
    return Analysis(
        range_map=range_map,
        profile=profile,
        mode=mode,
        surface=surface,
        ridge_points=ridge,
        wrinkles=tuple(wrinkles),
        table=table,
        section=section,
        pull=pull,
        opening=opening,
    )
