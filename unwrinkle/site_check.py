"""Every device of a site asked whether it is there and well; nothing is moved, and nothing is sent that could move anything."""

import datetime
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from unwrinkle._preflight_site import check_calibration
from unwrinkle._site_controller import ControllerFacts, listen, problem_of, reach
from unwrinkle.hardware.pan_tilt import FAULT, READY, PanTiltDriver
from unwrinkle.hardware.serial_port import open_serial
from unwrinkle.models.errors import HardwareError, InputError, UnwrinkleError
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import CameraSite, PanTiltSite, Site

_POLL = 0.01


@dataclass(frozen=True)
class DeviceRow:
    """One device, or one thing about it.

    Attributes:
        name: of it.
        passed: whether it is there and well.
        text: what was found; what is missing and what to do.
    """

    name: str
    passed: bool
    text: str


def check_site(
    site: Site,
    limits: Limits,
    *,
    today: datetime.date | None = None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> tuple[DeviceRow, ...]:
    """Ask every device of a site.

    Args:
        site: to check.
        limits: of the robot's axes.
        today: for the calibration's age.
        clock: monotonic, s.
        sleep: waits for a time, s.

    Returns:
        A row per device; what is missing is a value, not an exception.
    """
    day = datetime.date.today() if today is None else today
    rows = _controller_rows(site, limits, clock)
    for name, device in (("left", site.pan_tilt.left), ("right", site.pan_tilt.right)):
        label = f"{name} pan-tilt unit"
        rows.append(_row(label, partial(_unit, device, site.pan_tilt, label, clock, sleep)))
    rows.append(_row("cameras", lambda: _cameras(site.cameras)))
    rows.append(_row("grippers", lambda: _grippers(site)))
    rows.append(_row("calibration", lambda: check_calibration(site, day)))
    return tuple(rows)


def _row(name: str, ask: Callable[[], str]) -> DeviceRow:
    try:
        return DeviceRow(name, True, ask())
    except UnwrinkleError as error:
        return DeviceRow(name, False, str(error))


def _controller_rows(site: Site, limits: Limits, clock: Callable[[], float]) -> list[DeviceRow]:
    c = site.controller
    rows = []
    for name, port in (("motion", c.motion_port), ("I/O", c.io_port)):
        rows.append(_row(f"controller {name}", partial(reach, c, name, port)))
    facts: ControllerFacts | None = None
    try:
        facts = listen(c, clock)
        rows.append(DeviceRow("controller state", True, f"{c.host}:{c.state_port} answers"))
    except HardwareError as error:
        rows.append(DeviceRow("controller state", False, str(error)))
    if facts is None:
        return rows
    found = facts
    rows.append(_row("robot status", lambda: _status(found)))
    rows.append(_row("joint feedback", lambda: _feedback(site, found)))
    rows.append(_row("joint positions", lambda: _positions(site, limits, found)))
    return rows


def _status(facts: ControllerFacts) -> str:
    if facts.status is None:
        raise HardwareError(
            "no ROBOT_STATUS came within a second; is the state server the right one?"
        )
    if facts.status.problem:
        raise HardwareError(facts.status.problem)
    servo = "servo on" if facts.status.drives_powered == 1 else "servo off until the first motion"
    return f"play mode, no alarm, no emergency stop, {servo}"


def _feedback(site: Site, facts: ControllerFacts) -> str:
    problem = problem_of(site.controller, facts)
    if problem:
        raise HardwareError(problem)
    return (
        f"{facts.rate:.1f} sets a second of the groups {', '.join(site.controller.groups)}, longest gap "
        f"{1e3 * facts.longest_gap:.0f} ms"
    )


def _positions(site: Site, limits: Limits, facts: ControllerFacts) -> str:
    q = facts.positions
    if q is None:
        raise HardwareError("no whole set of joint positions came")
    if not np.isfinite(q).all():
        raise HardwareError("a joint position is not a finite number")
    out = np.flatnonzero((q < limits.lower - 5e-3) | (q > limits.upper + 5e-3))
    if len(out):
        text = ", ".join(f"axis {i + 1}: {q[i]:.3f} rad" for i in out)
        raise HardwareError(
            f"outside the robot's limits: {text}; are these degrees, or are the groups in another order than "
            f"{', '.join(site.controller.groups)}?"
        )
    return "within limits: " + " ".join(f"{np.degrees(value):.1f}" for value in q) + " deg"


def _unit(
    device: str,
    site: PanTiltSite,
    name: str,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> str:
    if not device:
        return "this site has none"
    port = open_serial(device, site.baud)
    try:
        driver = PanTiltDriver(port, site, None, f"{name} ({device})")
        end = clock() + 12.0 * site.reply_timeout
        while driver.status.state not in (READY, FAULT) and clock() < end:
            driver.poll(clock())
            sleep(_POLL)
        status = driver.status
        if status.state != READY:
            raise HardwareError(status.reason or f"{name} ({device}) did not answer; is it on?")
        arc = [np.degrees(step) * 3600.0 for step in driver.steps]
        return (
            f"{device}: stands at {np.degrees(status.pan):.2f}, {np.degrees(status.tilt):.2f} deg; a position is "
            f"{arc[0]:.1f}, {arc[1]:.1f} seconds of arc"
        )
    finally:
        port.close()


def _cameras(site: CameraSite) -> str:
    if site.kind == "none":
        return "this site has none"
    if site.kind in ("folder", "watch"):
        folder = Path(site.folder)
        if not folder.is_dir():
            raise InputError(f"cameras.folder {site.folder or '(empty)'} is no folder; make it")
        pairs = len(list(folder.glob("left*.png")))
        if site.kind == "folder" and not pairs:
            raise InputError(f"{folder} holds no left*.png; put pairs left*.png, right*.png there")
        return f"{site.kind} {folder}: {pairs} pictures of the left eye"
    if site.kind == "gphoto2":
        if find_spec("gphoto2") is None and shutil.which("gphoto2") is None:
            raise HardwareError("gphoto2 is not installed; pip install 'unwrinkle[gphoto2]'")
        return "gphoto2 is installed; `unwrinkle render` or a first look shows whether the cameras answer"
    if site.kind == "openni2" and find_spec("openni") is None:
        raise HardwareError("the package openni is not installed; pip install openni")
    return f"{site.kind}: its software is installed; no picture was taken"


def _grippers(site: Site) -> str:
    g = site.grippers
    if g.kind == "none":
        return "this site has none"
    if g.kind == "can":
        if find_spec("can") is None:
            raise HardwareError("python-can is not installed; pip install 'unwrinkle[can]'")
        return f"python-can is installed; {g.interface} {g.channel} was not opened"
    from unwrinkle._site_controller import read_inputs

    addresses = sorted({a for a in (*g.closed_input, *g.holding_input) if a} | set(g.close_output))
    values = read_inputs(site.controller, addresses)
    silent = [address for address, value in values.items() if value is None]
    if silent:
        raise HardwareError(
            f"the controller does not read the addresses {', '.join(map(str, silent))}; are they the right ones?"
        )
    return "digital: " + ", ".join(f"{address} is {value}" for address, value in values.items())
