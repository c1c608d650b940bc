"""What a station shows at one time, read where it is asked for; the same for every form of the station."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram

from unwrinkle.flattening.station_messages import DepthImage, GripperStatus, HeadImage
from unwrinkle.models.arrays import Array
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.measures import coverage, largest_height, overstretch
from unwrinkle.systems.station.motion_log import MotionLog, StationMotion

#: The cloth as it truly is; a station that is not simulated has no such port.
TRUTH = "truth.cloth"


class StationView:
    """Reads a station's output ports, whenever it is asked, out of a context that moves on with the run."""

    def __init__(self, station: Diagram, root: Context, cloth: Cloth | None) -> None:
        """Look at a station.

        Args:
            station: with the ports of `systems.ports`.
            root: context of the diagram that it is part of.
            cloth: what measures its truth; None for a station without.
        """
        self._station, self._root = station, root
        self._context = station.GetMyContextFromRoot(root)
        self._log: MotionLog | None = getattr(station, "motion_log", None)
        names = {
            station.get_output_port(index).get_name() for index in range(station.num_output_ports())
        }
        self._cloth = cloth if TRUTH in names else None

    def _of(self, name: str) -> Any:
        return self._station.GetOutputPort(name).Eval(self._context)

    @property
    def time(self) -> float:
        """The station's clock, s."""
        return float(self._context.get_time())

    @property
    def positions(self) -> Array:
        """Of the thirteen axes, rad."""
        return np.array(self._of("joints.position_measured"), dtype=float)

    @property
    def velocities(self) -> Array:
        """Of the thirteen axes, rad/s."""
        return np.array(self._of("joints.velocity_measured"), dtype=float)

    @property
    def head(self) -> Array:
        """Left pan, tilt, right pan, tilt, rad."""
        return np.array(self._of("head.position_measured"), dtype=float)

    @property
    def openings(self) -> Array:
        """Of the right and the left gripper, m."""
        status: GripperStatus = self._of("gripper.status")
        return np.array(status.opening, dtype=float)

    def motion(self, begin: float, end: float) -> StationMotion | None:
        """The motion in an interval of the station's clock (s), at the controller's own rate; None where it keeps no log."""
        return None if self._log is None else self._log.between(self._root, begin, end)

    def forget_motion(self) -> None:
        """Empty the controller's log, which would grow for as long as a run lasts."""
        if self._log is not None:
            self._log.clear(self._root)

    @property
    def pair(self) -> tuple[HeadImage, HeadImage]:
        """The head's last exposure."""
        return self._of("head.left_image"), self._of("head.right_image")

    @property
    def depth(self) -> DepthImage:
        """The depth camera's last exposure."""
        found: DepthImage = self._of("depth_camera.image")
        return found

    @property
    def cloth(self) -> ClothState | None:
        """How the cloth truly lies; None where there is no truth."""
        if self._cloth is None:
            return None
        found: ClothState = self._of(TRUTH)
        return found

    @property
    def vertices(self) -> Array | None:
        """The cloth's vertices (n, 3) in the world, m; None where there is no truth."""
        state = self.cloth
        if state is None or self._cloth is None:
            return None
        return self._cloth.vertices(state)

    def truth(self) -> dict[str, float] | None:
        """Coverage (share), largest height (m) and overstretch of the cloth; None where there is no truth."""
        state, cloth = self.cloth, self._cloth
        if state is None or cloth is None:
            return None
        return {
            "coverage": float(coverage(cloth, state)),
            "height": float(largest_height(cloth, state)),
            "overstretch": float(overstretch(cloth, state)),
        }
