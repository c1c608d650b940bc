"""Query a site's pan-tilt units, cameras and grippers; nothing of the robot moves."""

import time
from collections.abc import Callable
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from unwrinkle.hardware.cameras.base import PairPicture, expose
from unwrinkle.hardware.cameras.factory import is_depth_camera, make_cameras, make_depth_camera
from unwrinkle.hardware.cameras.folder import pairs_in
from unwrinkle.hardware.grippers.factory import make_grippers
from unwrinkle.hardware.pan_tilt.driver import ARC_SECOND, FAULT, READY, PanTiltDriver
from unwrinkle.hardware.pan_tilt.serial_port import open_serial
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import NO_DEVICE, CameraSite, GripperSite, PanTiltSite
from unwrinkle.perception.stereo.head import StereoHead

#: Time in addition to the site's timeout after which an exposure is aborted, s.
_MARGIN = 5.0
#: Polling period, s.
_POLL_PERIOD = 0.01

Clock = Callable[[], float]
Sleep = Callable[[float], None]

#: What to check when no pair arrives, by the kind of camera; the driver reports what is wrong with
#: an image.
_ADVICE = {
    "folder": "put pairs left*.png, right*.png of one size there",
    "watch": "release both cameras during this check, and check the folder of their program",
    "opencv": "check cameras.left and cameras.right, and whether other programs use the cameras",
    "gphoto2": "check cameras.left and cameras.right (`gphoto2 --auto-detect`)",
}


def exposure_time(site: CameraSite) -> float:
    """Return the maximum time that one picture of a site may take, s."""
    return max(site.attempts, 1) * (site.timeout + _MARGIN)


def check_unit(
    device: str, site: PanTiltSite, eye: str, head: StereoHead | None, clock: Clock, sleep: Sleep
) -> str:
    """Query a pan-tilt unit for its step, limits and position.

    Args:
        device: serial port; empty for none.
        site: baud rate and timeouts.
        eye: left or right.
        head: calibrated head whose step the unit must have; None without a calibration.
        clock, sleep: monotonic clock and waiting, s.

    Raises:
        HardwareError: the unit does not answer, or answers with impossible values.
    """
    if not device:
        return "this site has no pan-tilt unit"
    port = open_serial(device, site.baud)
    try:
        name = f"{eye} pan-tilt unit ({device})"
        step = None if head is None else getattr(head, eye).unit.step
        driver = PanTiltDriver(port, site, step, name)
        end = clock() + 12.0 * site.reply_timeout
        while driver.status.state not in (READY, FAULT) and clock() < end:
            driver.poll(clock())
            sleep(_POLL_PERIOD)
        status = driver.status
        if status.state != READY:
            raise HardwareError(status.reason or f"{name} did not answer; is it switched on?")
        axes = zip(
            ("pan", "tilt"), (status.pan, status.tilt), driver.limits, driver.steps, strict=True
        )
        return f"{device}: " + "; ".join(
            f"{axis} at {np.degrees(angle):.2f} deg of {np.degrees(lower):.1f} to "
            f"{np.degrees(upper):.1f}, {step / ARC_SECOND:.2f} seconds of arc per step"
            for axis, angle, (lower, upper), step in axes
        )
    finally:
        port.close()


def check_cameras(site: CameraSite, head: StereoHead | None = None) -> str:
    """Take one pair, or one depth frame.

    Args:
        site: settings of the cameras.
        head: calibrated head whose cameras must have taken the images; None without a calibration.

    Raises:
        InputError: the site lacks a setting that its kind of camera needs.
        HardwareError: there is no image, or it cannot be used.
    """
    if site.kind == NO_DEVICE:
        return "this site has no cameras"
    if is_depth_camera(site):
        return _depth_camera(site)
    if site.kind == "gphoto2" and find_spec("gphoto2") is None:
        raise HardwareError(
            "the package gphoto2 is not installed; install it with: pip install "
            "'unwrinkle[gphoto2]'"
        )
    camera = make_cameras(site)
    try:
        picture = expose(camera, 1, exposure_time(site))
    finally:
        camera.close()
    if picture.left is None or picture.right is None:
        advice = _ADVICE.get(site.kind, "check the cameras' settings in the site")
        raise HardwareError(f"{picture.reason}; {advice}")
    height, width = picture.left.shape[:2]
    size = f"{width} x {height} pixels"
    _check_size(size, width, height, head)
    if site.kind == "folder":
        folder = Path(site.folder).expanduser()
        pairs = pairs_in(folder, site.left or "left", site.right or "right")
        left, right = (path.name for path in pairs[0])
        return (
            f"folder {folder}: {len(pairs)} pairs, the next is {left} and {right} of {size}; files "
            "do not state when they were exposed"
        )
    return f"{site.kind}: a pair of {size}, {_times(picture)}, at most {1e3 * site.skew:.0f} ms"


def _check_size(size: str, width: int, height: int, head: StereoHead | None) -> None:
    """Refuse images that do not have the calibrated size, or its aspect at a smaller size."""
    for eye in () if head is None else (head.left, head.right):
        factor = width / eye.camera.width
        if factor > 1.0 or abs(eye.camera.height * factor - height) > 1.0:
            raise HardwareError(
                f"the images are of {size}, but the {eye.name} camera is calibrated for "
                f"{eye.camera.width} x {eye.camera.height} pixels; set the cameras to that size, "
                "or calibrate the head again"
            )


def _times(picture: PairPicture) -> str:
    left, right = (
        datetime.fromtimestamp(when).strftime("%H:%M:%S.%f")[:-3]
        for when in (picture.time_left, picture.time_right)
    )
    apart = 1e3 * abs(picture.time_left - picture.time_right)
    return f"left at {left}, right at {right}: {apart:.0f} ms apart"


def _depth_camera(site: CameraSite) -> str:
    camera = make_depth_camera(site)
    try:
        camera.start(1)
        end = time.monotonic() + exposure_time(site)
        while camera.result is None and time.monotonic() < end:
            camera.poll(time.monotonic())
            time.sleep(_POLL_PERIOD)
        picture = camera.result
    finally:
        camera.close()
    if picture is None or picture.depth is None:
        raise HardwareError(
            f"no depth frame arrived within {exposure_time(site):g} s; unplug the camera and plug "
            "it in again"
            if picture is None
            else picture.reason
        )
    height, width = picture.depth.shape
    known = picture.depth[np.isfinite(picture.depth)]
    when = datetime.fromtimestamp(picture.time).strftime("%H:%M:%S.%f")[:-3]
    colour = "without colour" if picture.colour is None else "with colour"
    return (
        f"{site.kind}: a depth frame of {width} x {height} pixels {colour} at {when}, "
        f"{known.size / picture.depth.size:.0%} of it from {known.min():.2f} to {known.max():.2f} "
        f"m, median {np.median(known):.2f} m"
    )


def check_grippers(site: GripperSite, clock: Clock, sleep: Sleep) -> str:
    """Query grippers that are not on the controller, for at most the site's timeout.

    Raises:
        HardwareError: their bus cannot be opened or fails, or a gripper does not answer or is not
            ready.
    """
    grippers = make_grippers(site)
    try:
        end = clock() + site.timeout
        grippers.poll(clock())
        while grippers.problem and not grippers.status.reason and clock() < end:
            sleep(_POLL_PERIOD)
            grippers.poll(clock())
        problem, found = grippers.status.reason or grippers.problem, grippers.found
    finally:
        grippers.close()
    if problem:
        raise HardwareError(problem)
    return f"{site.kind}: {found}"
