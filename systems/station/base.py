"""The station: a diagram with the same ports in each of its forms."""

from pydrake.systems.framework import Diagram

from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import StationForm
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.simulation.cloth.cloth import Cloth


class Station(Diagram):
    """Robot, grippers, head and cameras behind the ports of `flattening.station_messages`.

    Attributes:
        form: sim, loopback or hardware.
        cell: robot and cell.
        head: stereo head, as perception knows it.
        seed: of the random numbers.
        site: of the devices; None in the sim form.
        cloth: solver of the simulated garment; None if the garment is real.
        real: whether the devices run in real time, so that the diagram must not be faster.
    """

    form: StationForm
    cell: Cell
    head: StereoHead
    seed: int = 0
    site: Site | None = None
    cloth: Cloth | None = None

    @property
    def real(self) -> bool:
        """Return whether the station moves a robot, in real time."""
        return self.form == StationForm.HARDWARE
