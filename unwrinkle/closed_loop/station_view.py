"""Read a station's outputs on demand, the same way for every form of the station."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from unwrinkle.flattening.station_messages import DepthImage, GripperStatus, HeadImage
from unwrinkle.models.arrays import Array
from unwrinkle.simulation.cloth.cloth import ClothState
from unwrinkle.simulation.cloth.measures import coverage, largest_height, overstretch
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.motion_log import MotionLog, StationMotion

#: Output port of the simulated cloth's state; only simulated stations have it.
TRUTH = "truth.cloth"


class StationView:
    """Read a station's output ports from a context that advances with the run."""

    def __init__(self, station: Station, root: Context) -> None:
        """Observe a station.

        Args:
            station: station with the ports that `systems.diagram` connects.
            root: context of the root diagram.
        """
        self._station, self._root = station, root
        self._context = station.GetMyContextFromRoot(root)
        self._log: MotionLog | None = getattr(station, "motion_log", None)
        self._cloth = station.cloth

    def _of(self, name: str) -> Any:
        return self._station.GetOutputPort(name).Eval(self._context)

    @property
    def time(self) -> float:
        """Return the time of the station's clock, s."""
        return float(self._context.get_time())

    @property
    def positions(self) -> Array:
        """Return the measured positions of the axes (13,), rad."""
        return np.array(self._of("joints.position_measured"), dtype=float)

    @property
    def velocities(self) -> Array:
        """Return the measured velocities of the axes (13,), rad/s."""
        return np.array(self._of("joints.velocity_measured"), dtype=float)

    @property
    def head(self) -> Array:
        """Return the head's angles (4,): left pan, tilt, right pan, tilt, rad."""
        return np.array(self._of("head.position_measured"), dtype=float)

    @property
    def openings(self) -> Array:
        """Return the openings of the right and the left gripper (2,), m."""
        status: GripperStatus = self._of("gripper.status")
        return np.array(status.opening, dtype=float)

    def motion(self, begin: float, end: float) -> StationMotion | None:
        """Return the motion in an interval of the station's clock (s) at the controller's rate.

        Without a motion log it is None.
        """
        return None if self._log is None else self._log.between(self._root, begin, end)

    def forget_motion(self) -> None:
        """Delete the motion log, which would otherwise grow during the whole run."""
        if self._log is not None:
            self._log.clear(self._root)

    @property
    def pair(self) -> tuple[HeadImage, HeadImage]:
        """Return the head's last pair of images."""
        return self._of("head.left_image"), self._of("head.right_image")

    @property
    def depth(self) -> DepthImage:
        """Return the depth camera's last image."""
        found: DepthImage = self._of("depth_camera.image")
        return found

    @property
    def cloth(self) -> ClothState | None:
        """Return the true state of the cloth; None if the station is not simulated."""
        if self._cloth is None:
            return None
        found: ClothState = self._of(TRUTH)
        return found

    @property
    def vertices(self) -> Array | None:
        """Return the cloth's vertices (n, 3) in the world frame, m.

        They are None if the station is not simulated.
        """
        state = self.cloth
        if state is None or self._cloth is None:
            return None
        return self._cloth.vertices(state)

    def truth(self) -> dict[str, float] | None:
        """Return the cloth's true coverage (share), height (m) and overstretch.

        They are None if the station is not simulated.
        """
        state, cloth = self.cloth, self._cloth
        if state is None or cloth is None:
            return None
        return {
            "coverage": float(coverage(cloth, state)),
            "height": float(largest_height(cloth, state)),
            "overstretch": float(overstretch(cloth, state)),
        }
