"""Drake system of depth perception: an image of the depth camera in, the range map out."""

from unwrinkle.flattening.capture_to_observation import map_of
from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.systems.perception.base import PerceptionSystem


class DepthPerceptionSystem(PerceptionSystem):
    """Compute the range map from the depth camera's last image. Input: `image` (`DepthImage`)."""

    def __init__(self, cell: Cell, *, seed: int = 0) -> None:
        """Keep the cell.

        Args:
            cell: robot and cell.
            seed: seed of perception's random numbers.
        """
        super().__init__({"image": DepthImage()}, unseen=0.0)
        self._cell, self._seed = cell, seed

    def range_map(self, number: int, image: DepthImage) -> RangeMap:
        """Compute the range map of a look.

        Raises:
            InputError: there is no image, or the camera's pose is unknown.
        """
        if image.capture is None:
            raise InputError(
                f"look {number}: the depth camera returned no image"
                f"{': ' if image.reason else ''}{image.reason}"
            )
        if image.capture.X_WC is None:
            raise InputError(f"look {number}: the depth camera's pose is not known")
        return map_of(image.capture, self._cell, seed=self._seed)

    def unseen(self, image: DepthImage) -> float:
        """Return the height of the lowest garment in the camera's noise profile, m."""
        if image.capture is None:
            return 0.0
        return noise_profile(image.capture.camera.sensor).garment_height
