"""Drake system of ideal perception.

Its range map is the simulated cloth's own surface with the stereo head's noise, for long studies.
"""

import numpy as np

from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.systems.perception.base import PerceptionSystem
from unwrinkle.systems.perception.stereo import UNSEEN
from unwrinkle.systems.perception.true_range_map import true_range_map


class TruePerceptionSystem(PerceptionSystem):
    """Compute the range map of an unobstructed view from above; available in simulation only.

    Inputs: `image` (`DepthImage`), the number of the look and whether its exposure failed; `cloth`
    (`ClothState`), the cloth at the exposure: the map does not change while the arms move the
    cloth.
    """

    def __init__(self, cloth: Cloth, state: ClothState, *, seed: int = 0) -> None:
        """Keep the solver of the cloth.

        Args:
            cloth: solver of the cloth.
            state: any state of it, for the type of the port.
            seed: seed of the noise; each look has its own noise.
        """
        super().__init__({"image": DepthImage(), "cloth": state}, unseen=UNSEEN, depends_on=1)
        self._solver, self._seed = cloth, seed

    def range_map(self, number: int, image: DepthImage, cloth: ClothState) -> RangeMap:
        """Sample the cloth's surface.

        Raises:
            InputError: the exposure failed.
        """
        if image.reason:
            raise InputError(f"look {number}: {image.reason}")
        seeds = np.random.SeedSequence([self._seed, number])
        return true_range_map(self._solver, cloth, int(seeds.generate_state(1)[0]))
