"""In place of a camera: the simulated cloth's own surface with the stereo head's noise, for studies that need many looks."""

import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.systems.latest import Latest
from unwrinkle.systems.perception.stereo import UNSEEN, failed
from unwrinkle.systems.perception.true_range_map import true_range_map

_Look = tuple[DepthImage, ClothState]


class TruePerception(LeafSystem):
    """The range map that a perfect view from above would give of the cloth as it lies; simulation alone has it.

    Inputs: `image` (`DepthImage`), which says when a look was taken and whether it failed; `cloth` (`ClothState`). Outputs:
    `exposed`, vector (1,), number of the last look, cheap; `range_map` (`Perceived`), computed when it is evaluated.
    """

    def __init__(self, cloth: Cloth, state: ClothState, *, seed: int = 0) -> None:
        """Look at a cloth.

        Args:
            cloth: its solver.
            state: any of it, for the port's type.
            seed: of the noise; every look has its own.
        """
        super().__init__()
        self._solver, self._seed = cloth, seed
        image = self.DeclareAbstractInputPort("image", AbstractValue.Make(DepthImage()))
        self.DeclareAbstractInputPort("cloth", AbstractValue.Make(state))
        ticket = self.input_port_ticket(image.get_index())
        self.DeclareVectorOutputPort("exposed", 1, self._exposed, {ticket})
        self.DeclareAbstractOutputPort(
            "range_map",
            lambda: AbstractValue.Make(Perceived()),
            self._perceive,
            {ticket, self.input_port_ticket(self.GetInputPort("cloth").get_index())},
        )
        # The cloth is looked at once: the map stays that of the exposure while the arms move it.
        self._latest = Latest(self._range_map, lambda a, b: a[0] is b[0])

    def _exposed(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self.get_input_port(0).Eval(context).number)

    def _perceive(self, context: Context, output: AbstractValue) -> None:
        image = self.get_input_port(0).Eval(context)
        output.set_value(self._latest((image, self.get_input_port(1).Eval(context))))

    def _range_map(self, look: _Look) -> Perceived:
        image, cloth = look
        if image.number == 0:
            return Perceived(reason="nothing was looked at yet")
        clock = time.perf_counter()
        seeds = np.random.SeedSequence([self._seed, image.number])
        try:
            if image.reason:
                raise InputError(f"look {image.number}: {image.reason}")
            found = true_range_map(self._solver, cloth, int(seeds.generate_state(1)[0]))
        except InputError as error:
            return failed(image.number, error, clock, unseen=UNSEEN)
        return Perceived(image.number, found, seconds=time.perf_counter() - clock)
