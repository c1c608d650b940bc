"""Conditions for a station that moves a robot. Each is checked before a device is opened."""

import datetime
from pathlib import Path

from unwrinkle.hardware.cameras.factory import is_depth_camera
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import resolve
from unwrinkle.models.site import NO_DEVICE, Site
from unwrinkle.perception.stereo.head_file import (
    HeadCalibration,
    load_calibration,
    nominal_calibration,
)


def check_permitted(cell: Cell, site: Site | None, *, go: bool, today: datetime.date) -> Site:
    """Check that the loop may move the robot of a site, and return the site.

    Args:
        cell: its scenario states the sensor.
        site: of the devices.
        go: whether an operator permits motion and approves each plan.
        today: for the calibration's age.

    Raises:
        InputError: the site is missing, is under commissioning, lacks a device, or has cameras of
            the wrong kind; nobody approves plans; or the calibration is missing, old or inaccurate.
    """
    if site is None:
        raise InputError(
            "the hardware station needs --site FILE; examples are in models/data/sites"
        )
    if not go:
        raise InputError(
            f"the hardware station moves the robot of site {site.name}: add --go to permit this, "
            "or rehearse with --station loopback"
        )
    if site.commissioning:
        raise InputError(
            f"site {site.name} is under commissioning: run single plans with `unwrinkle execute` "
            "first; then set commissioning: false"
        )
    stereo = cell.scenario.sensor.kind == "stereo"
    if stereo:
        check_calibration(site, today)
    check_complete(site, stereo=stereo)
    return site


def check_complete(site: Site, *, stereo: bool) -> None:
    """Check that a site has what the closed loop needs.

    Raises:
        InputError: keys are missing, or the cameras are of the wrong kind.
    """
    needed = {
        "cameras.kind": site.cameras.kind.replace(NO_DEVICE, ""),
        "grippers.kind": site.grippers.kind.replace(NO_DEVICE, ""),
    }
    if stereo:
        needed |= {"pan_tilt.left": site.pan_tilt.left, "pan_tilt.right": site.pan_tilt.right}
    lacking = sorted(key for key, value in needed.items() if not value)
    if lacking:
        raise InputError(f"site {site.name}: the closed loop needs {', '.join(lacking)}")
    if not stereo and not is_depth_camera(site.cameras):
        raise InputError(
            f"the scenario's sensor is a depth camera, but cameras.kind of site {site.name} is "
            f"'{site.cameras.kind}'; give openni2, or use --sensor stereo"
        )
    if stereo and is_depth_camera(site.cameras):
        raise InputError(
            f"cameras.kind of site {site.name} is '{site.cameras.kind}', a depth camera, but the "
            "scenario's sensor is the head; use --sensor xtion, or give cameras of the head"
        )


def check_calibration(site: Site, today: datetime.date) -> str:
    """Check that the head's calibration exists, is recent and accurate, and describe it.

    Raises:
        InputError: it is missing, or cannot be used on a real robot.
    """
    calibration = calibration_of(site)
    file = Path(site.calibration).name if site.calibration else "nominal calibration"
    problems = []
    age = (today - datetime.date.fromisoformat(calibration.date)).days
    most = min(site.calibration_days, calibration.valid_days)
    if age > most:
        problems.append(f"it is {age} days old, at most {most}")
    if age < 0:
        problems.append(f"its date {calibration.date} is in the future")
    if min(calibration.left.views, calibration.right.views) < 1:
        problems.append("it is nominal, not measured with a calibration board")
    residual = max(calibration.left.residual, calibration.right.residual, calibration.row_residual)
    if residual > site.calibration_residual:
        problems.append(
            f"its residual is {residual:.2f} pixels, at most {site.calibration_residual:g}"
        )
    label = f"{file}, {calibration.date}"
    if not problems:
        return f"{label}, {age} days old, residual {residual:.2f} pixels"
    text = "; ".join(problems)
    if site.virtual:
        return f"{label}: {text}; allowed for virtual equipment only"
    raise InputError(f"{label}: {text}; calibrate the head again with `unwrinkle calibrate`")


def calibration_of(site: Site) -> HeadCalibration:
    """Load the calibration of a site's head; the nominal one for virtual equipment.

    Raises:
        InputError: the site names none, or its file is wrong.
    """
    if site.calibration:
        return load_calibration(resolve(site.calibration))
    if not site.virtual:
        raise InputError(
            f"site '{site.name}' names no calibration of the head; make one with `unwrinkle "
            "calibrate` and name it under calibration"
        )
    return nominal_calibration()
