"""An observation: what was analysed of one look at the table, and the features that the policy
decides by.
"""

import dataclasses as dc
import math
from dataclasses import dataclass

from unwrinkle.flattening.garment_surface import garment_of
from unwrinkle.flattening.wrinkle_order import flattened_together, highest_part
from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import KnownGarment
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.models.shared import Shared
from unwrinkle.perception.folds.garment_state import FoldAnalysis, GarmentState, analyse_folds
from unwrinkle.perception.folds.ridge_kinds import RidgeKind
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.planning.plan import GarmentSurface


@dataclass(frozen=True)
class WrinkleFeatures:
    """Features of a wrinkle that the policy uses.

    Attributes:
        index: in the analysis, largest first.
        centre: x, y in the world, m.
        angle: of its direction, rad.
        volume: argument of Eq. 4's logarithms, length times mean of width times height, mm^3.
        pull: pull distance of Eq. 5, m.
        height: of its highest part over the line between its feet, m.
        length: along its ridge line, m.
        together: volume of all wrinkles that a pull across it flattens, mm^3; see `wrinkle_order`.
        kind: only wrinkles are pulled, no borders of layers and no bulges of stacks.
    """

    index: int
    centre: tuple[float, float]
    angle: float
    volume: float
    pull: float
    height: float
    length: float = 0.0
    together: float = 0.0
    kind: RidgeKind = RidgeKind.WRINKLE


@dataclass(frozen=True)
class GarmentFeatures(Shared):
    """Features of a garment that the policy uses.

    Attributes:
        wrinkles: largest first; ridges that are no wrinkles come last.
        halting_pull: of the sensor, m: a wrinkle with a smaller pull distance is flat.
        noise: standard deviation of the sensor's readings, m.
        beyond: share of the garment's visible area beyond the table's edges.
        along_edge: share of its outline along the table's edges.
        state: of the garment by its layers and heights: flat, wrinkled, folded or crumpled, or not
            seen well enough. Whether a wrinkle is worth pulling comes on top.
        reasons: of that state.
    """

    wrinkles: tuple[WrinkleFeatures, ...] = ()
    halting_pull: float = 0.005
    noise: float = 0.0
    beyond: float = 0.0
    along_edge: float = 0.0
    state: GarmentState = GarmentState.FLAT
    reasons: tuple[str, ...] = ()

    def worth_pulling(self, rules: LoopSettings) -> list[WrinkleFeatures]:
        """Return the wrinkles that are not flat, largest first.

        A wrinkle is not flat if its pull distance reaches the sensor's halting pull, or if it is
        higher than the halting height of the rules. Heights within the sensor's noise
        (`rules.noise_multiple`) do not count, nor do ridges of another kind.
        """
        halting_height = max(rules.halting_height, rules.noise_multiple * self.noise)
        return [
            wrinkle
            for wrinkle in self.wrinkles
            if wrinkle.kind is RidgeKind.WRINKLE
            and (wrinkle.pull >= self.halting_pull or wrinkle.height > halting_height)
        ]

    def volumes(self, rules: LoopSettings) -> tuple[float, float]:
        """Return the greatest volume and the sum of the volumes of the wrinkles worth pulling,
        mm^3.

        Low wrinkles are left out: the sensor's noise makes some and removes others from look to
        look.
        """
        volumes = [wrinkle.volume for wrinkle in self.worth_pulling(rules)]
        return max(volumes, default=0.0), sum(volumes)


@dataclass(frozen=True, eq=False)
class Observation(Shared):
    """What was seen of a garment.

    Attributes:
        analysis: surface and wrinkles of its range map; ridges that are no wrinkles come last.
        folds: layers and folds, and the state of the garment.
        features: that the policy decides by.
    """

    analysis: Analysis
    folds: FoldAnalysis
    features: GarmentFeatures

    @classmethod
    def of(cls, analysis: Analysis, known: KnownGarment | None = None) -> "Observation":
        """Find the folds of an analysed garment, and compute the features of both.

        Args:
            analysis: of its range map.
            known: the garment as it is when flat, if that is known.
        """
        folds = analyse_folds(analysis.range_map, analysis.wrinkles, analysis.profile, known)
        order = sorted(
            range(len(folds.kinds)), key=lambda k: folds.kinds[k] is not RidgeKind.WRINKLE
        )
        wrinkles = tuple(analysis.wrinkles[k] for k in order)
        analysis = dc.replace(analysis, wrinkles=wrinkles, layers=folds.layers)
        folds = dc.replace(folds, kinds=tuple(folds.kinds[k] for k in order))
        together = flattened_together(analysis.wrinkles, analysis.section)
        features = GarmentFeatures(
            tuple(
                WrinkleFeatures(
                    index=index,
                    centre=(float(wrinkle.centre[0]), float(wrinkle.centre[1])),
                    angle=math.atan2(wrinkle.direction[1], wrinkle.direction[0]),
                    volume=math.exp(wrinkle.volume_score),
                    pull=wrinkle.pull_distance(analysis.mode),
                    height=highest_part(wrinkle),
                    length=wrinkle.length,
                    together=together[index],
                    kind=folds.kinds[index],
                )
                for index, wrinkle in enumerate(analysis.wrinkles)
            ),
            analysis.profile.halting_pull,
            analysis.profile.depth_noise,
            analysis.share_beyond_table,
            analysis.share_along_edge,
            folds.state,
            folds.reasons,
        )
        return cls(analysis, folds, features)

    def garment(self, wrinkle: int) -> GarmentSurface | None:
        """Return the garment as a mesh with one of its wrinkles, for a plan's preview.

        None if too little was seen.
        """
        try:
            return garment_of(self.analysis, wrinkle)
        except InputError:
            return None
