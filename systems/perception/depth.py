"""Depth perception as a system: the depth camera's picture to the range map."""

from unwrinkle.flattening.perceiving import map_of
from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.systems.perception.base import PerceptionSystem


class DepthPerceptionSystem(PerceptionSystem):
    """The garment in the depth camera's last exposure. Input: `image` (`DepthImage`)."""

    def __init__(self, cell: Cell, *, seed: int = 0) -> None:
        """Keep the cell.

        Args:
            cell: the robot in its cell.
            seed: of perception's random choices.
        """
        super().__init__({"image": DepthImage()}, unseen=0.0)
        self._cell, self._seed = cell, seed

    def range_map(self, number: int, image: DepthImage) -> RangeMap:
        """Find the garment on the table."""
        if image.capture is None:
            raise InputError(
                f"look {number}: the depth camera returned nothing"
                f"{': ' if image.reason else ''}{image.reason}"
            )
        if image.capture.X_WC is None:
            raise InputError(f"look {number}: the depth camera's pose is not known")
        return map_of(image.capture, self._cell, seed=self._seed)

    def unseen(self, image: DepthImage) -> float:
        """Return what the camera's own noise profile says."""
        if image.capture is None:
            return 0.0
        return noise_profile(image.capture.camera.sensor).garment_height
