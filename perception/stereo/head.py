"""Kinematics of the stereo head: from pan-tilt angles to camera poses, and back.

Frames: W world; R turn-table, which carries the head; B base of a pan-tilt unit; M its mount; C
camera. +pan turns the camera to the left, +tilt raises the view; at zero the camera looks along +x
of M.
"""

from dataclasses import astuple, dataclass
from math import atan2, hypot, isfinite

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose, transformed, turn
from unwrinkle.perception.camera import Camera

#: Limit of Newton iterations when aiming.
_MAX_AIM_ITERATIONS = 20

#: Tangent of the angle between optical axis and point at which aiming has converged.
_AIM_TOLERANCE = 1e-10


@dataclass(frozen=True)
class PanTiltUnit:
    """Kinematics and limits of a pan-tilt unit (PTU-D46).

    Attributes:
        pan_origin: intersection of both axes in the base's frame, metres.
        mount_origin: the mount's origin in the frame of the tilting stage, metres.
        step: the motors' resolution, radians.
        pan, tilt: lower and upper limits, radians.
    """

    pan_origin: tuple[float, float, float] = (0.0, -0.009525, 0.091694)
    mount_origin: tuple[float, float, float] = (0.0, 0.0, 0.039116)
    step: float = 0.0
    pan: tuple[float, float] = (0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)

    def mount_pose(self, pan: float, tilt: float) -> Pose:
        """Return X_BM (4, 4) at angles in radians; the limits are not checked."""
        X_BP = pose(np.eye(3), np.array(self.pan_origin)) @ turn("z", pan) @ turn("y", -tilt)
        return np.asarray(X_BP @ pose(np.eye(3), np.array(self.mount_origin)))

    def check(self, pan: float, tilt: float, name: str) -> None:
        """Check that the angles, radians, are within the limits.

        Raises:
            InputError: an angle is beyond its limits; the message names the unit (`name`).
        """
        for axis, angle, (lower, upper) in (("pan", pan, self.pan), ("tilt", tilt, self.tilt)):
            if not isfinite(angle):
                raise InputError(f"{name}: {axis} is {angle}; give a finite angle in radians")
            if not lower <= angle <= upper:
                over = max(lower - angle, angle - upper)
                raise InputError(
                    f"{name}: {axis} {angle:.4f} rad is beyond its limits {lower:.3f} to "
                    f"{upper:.3f} by {over:.4f}; angles are in radians, look elsewhere"
                )


@dataclass(frozen=True)
class Gaze:
    """Gaze of the head: the angles of its pan-tilt units and of the turn-table, radians."""

    left_pan: float = 0.0
    left_tilt: float = 0.0
    right_pan: float = 0.0
    right_tilt: float = 0.0
    ext_axis: float = 0.0

    @property
    def left(self) -> tuple[float, float]:
        """Pan and tilt of the left unit."""
        return self.left_pan, self.left_tilt

    @property
    def right(self) -> tuple[float, float]:
        """Pan and tilt of the right unit."""
        return self.right_pan, self.right_tilt


@dataclass(frozen=True, eq=False)
class Eye:
    """Camera on a pan-tilt unit.

    Attributes:
        name: "left" or "right", for messages.
        camera: intrinsics and distortion.
        unit: the pan-tilt unit.
        X_RB: (4, 4) pose of the unit's base in the turn-table's frame.
        X_MC: (4, 4) pose of the camera in the mount's frame (hand-eye transform).
    """

    name: str
    camera: Camera
    unit: PanTiltUnit
    X_RB: Pose
    X_MC: Pose

    def pose(self, pan: float, tilt: float) -> Pose:
        """Return X_RC (4, 4), the camera in the turn-table's frame, at angles in radians.

        Raises:
            InputError: the angles are beyond the unit's limits.
        """
        self.unit.check(pan, tilt, f"{self.name} eye")
        return np.asarray(self.X_RB @ self.unit.mount_pose(pan, tilt) @ self.X_MC)

    def aim(self, p_RQ: NDArray[np.float64]) -> tuple[float, float]:
        """Return pan and tilt, radians, whose optical axis passes through a point (3,) of frame R.

        Raises:
            InputError: the point is behind the unit, on its axes, or beyond its limits.
        """
        p_BQ = transformed(inverse(self.X_RB), np.asarray(p_RQ, dtype=float))
        x, y, z = p_BQ - np.array(self.unit.pan_origin)
        angles = np.array([atan2(y, x), atan2(z, hypot(x, y))])
        for _ in range(_MAX_AIM_ITERATIONS):
            missed = self._off_axis(angles, p_BQ)
            if not np.isfinite(missed).all():
                break
            if np.abs(missed).max() < _AIM_TOLERANCE:
                pan, tilt = float(angles[0]), float(angles[1])
                self.unit.check(pan, tilt, f"{self.name} eye, to look at {np.round(p_RQ, 3)}")
                return pan, tilt
            step = 1e-6
            slopes = [
                (self._off_axis(angles + step * unit, p_BQ) - missed) / step for unit in np.eye(2)
            ]
            angles = angles - np.linalg.solve(np.column_stack(slopes), missed)
        raise InputError(
            f"{self.name} eye: cannot look at {np.round(p_RQ, 3)} m (turn-table's frame); "
            "choose a point in front of the head"
        )

    def _off_axis(
        self, angles: NDArray[np.float64], p_BQ: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        X_BC = self.unit.mount_pose(float(angles[0]), float(angles[1])) @ self.X_MC
        x, y, z = transformed(inverse(X_BC), p_BQ)
        return np.array([x, y]) / z if z > 0.0 else np.full(2, np.nan)


@dataclass(frozen=True, eq=False)
class StereoHead:
    """Stereo head: two cameras on pan-tilt units on the turn-table.

    Attributes:
        name: of the head; calibrations and head-angle files refer to it.
        left, right: the eyes.
        turntable_height: of R's origin above the floor, metres.
        turntable_yaw: of R about the world's z at ext_axis = 0, radians.
    """

    name: str
    left: Eye
    right: Eye
    turntable_height: float
    turntable_yaw: float

    def turntable_pose(self, ext_axis: float) -> Pose:
        """Return X_WR (4, 4) at an angle of the turn-table, radians."""
        X_WR = turn("z", self.turntable_yaw + ext_axis)
        X_WR[2, 3] = self.turntable_height
        return X_WR

    def poses(self, gaze: Gaze) -> tuple[Pose, Pose]:
        """Return the poses (4, 4) of the left and the right camera in the world.

        Raises:
            InputError: an angle is beyond its limits.
        """
        if not all(isfinite(angle) for angle in astuple(gaze)):
            raise InputError(f"head {self.name!r}: {gaze} has an angle that is not finite")
        X_WR = self.turntable_pose(gaze.ext_axis)
        return X_WR @ self.left.pose(*gaze.left), X_WR @ self.right.pose(*gaze.right)

    def relative(self, gaze: Gaze) -> Pose:
        """Return X_LR (4, 4), the right camera in the left camera's frame.

        Raises:
            InputError: an angle is beyond its limits.
        """
        X_WL, X_WR = self.poses(gaze)
        return np.asarray(inverse(X_WL) @ X_WR)

    def gaze_at(self, p_WQ: NDArray[np.float64], ext_axis: float = 0.0) -> Gaze:
        """Return the gaze whose optical axes both pass through a point (3,) of the world.

        Raises:
            InputError: a unit cannot look there.
        """
        p_RQ = transformed(inverse(self.turntable_pose(ext_axis)), np.asarray(p_WQ, dtype=float))
        return Gaze(*self.left.aim(p_RQ), *self.right.aim(p_RQ), ext_axis)
