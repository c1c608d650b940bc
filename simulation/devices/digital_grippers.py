"""Virtual grippers on a controller's digital outputs, with sensors on its inputs."""

from collections.abc import Mapping

from unwrinkle.models.site import GripperSite


class VirtualDigitalGrippers:
    """A right and a left gripper.

    Attributes:
        commanded: whether the outputs command to close, right and left.
        closed: whether the grippers are closed, a stroke later.
    """

    def __init__(self, site: GripperSite, stroke_time: float = 0.5) -> None:
        """Begin with open grippers.

        Args:
            site: addresses of outputs and inputs.
            stroke_time: from a change of the output until the sensors change, s.
        """
        self._site, self._stroke_time = site, stroke_time
        self.commanded = self.closed = (False, False)
        self._since = [float("-inf"), float("-inf")]

    def update(
        self,
        now: float,
        outputs: Mapping[int, int],
        holding: tuple[bool, bool] = (True, True),
    ) -> dict[int, int]:
        """Advance to a time.

        Args:
            now: of any monotonic clock, s.
            outputs: of the controller, 0 or 1 by address; one that was never written means open.
            holding: whether there is cloth between the blades, right and left.

        Returns:
            Inputs set by the grippers' sensors, 0 or 1 by address.
        """
        site = self._site
        commanded, closed = list(self.commanded), list(self.closed)
        inputs: dict[int, int] = {}
        for hand in (0, 1):
            inverted = site.inverted[hand]
            wanted = bool(outputs.get(site.close_output[hand], int(inverted))) != inverted
            if wanted != commanded[hand]:
                commanded[hand], self._since[hand] = wanted, now
            if now - self._since[hand] >= self._stroke_time - 1e-9:
                closed[hand] = commanded[hand]
            for address, value in (
                (site.closed_input[hand], closed[hand]),
                (site.holding_input[hand], closed[hand] and holding[hand]),
            ):
                if address:
                    inputs[address] = int(value)
        self.commanded, self.closed = (commanded[0], commanded[1]), (closed[0], closed[1])
        return inputs
