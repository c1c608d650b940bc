"""Check that every device of a site answers and works; nothing is sent that could move the robot.

The controller's motion port is connected to only if its status reports empty queues: it would run
their content as soon as it accepts a connection. The cameras take one picture; the shutter of a
DSLR is all that moves.
"""

import datetime
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from unwrinkle.hardware.controller.driver import QUEUE_LEFT
from unwrinkle.hardware.grippers.factory import needs_io
from unwrinkle.models.errors import HardwareError, UnwrinkleError
from unwrinkle.models.limits import Limits
from unwrinkle.models.scenario import resolve
from unwrinkle.models.site import GROUPS, NO_DEVICE, Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import load_calibration
from unwrinkle.site._controller import ControllerFacts, listen, problem_of, reach, read_inputs
from unwrinkle.site._devices import check_cameras, check_grippers, check_unit, exposure_time
from unwrinkle.systems.station.preconditions import check_calibration


@dataclass(frozen=True)
class DeviceRow:
    """Result of one check of a device.

    Attributes:
        name: device, or one property of it.
        passed: whether it answers and works.
        text: what was found; for a failure, what is missing and what to do.
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
    tell: Callable[[str], None] = lambda text: None,
) -> tuple[DeviceRow, ...]:
    """Check every device of a site.

    Args:
        site: site to check.
        limits: limits of the robot's axes.
        today: date for the calibration's age; today if left out.
        clock: monotonic clock, s.
        sleep: function that waits for a time, s.
        tell: function that displays which device is checked, with the maximum duration if that may
            be long.

    Returns:
        A row per device; a missing device is a result, not an exception.
    """
    day = datetime.date.today() if today is None else today
    tell("the controller")
    rows = _controller_rows(site, limits, clock)
    head = _calibrated(site, limits)
    for eye, device in (("left", site.pan_tilt.left), ("right", site.pan_tilt.right)):
        label = f"{eye} pan-tilt unit"
        tell(f"the {label}")
        ask = partial(check_unit, device, site.pan_tilt, eye, head, clock, sleep)
        rows.append(_row(label, ask))
    most = f", for at most {exposure_time(site.cameras):.0f} s"
    watch = "; release them now" if site.cameras.kind == "watch" else ""
    tell("the cameras" + ("" if site.cameras.kind == "none" else most + watch))
    rows.append(_row("cameras", lambda: check_cameras(site.cameras, head)))
    tell("the grippers")
    rows.append(_row("grippers", lambda: _grippers(site, clock, sleep)))
    rows.append(_row("calibration", lambda: check_calibration(site, day)))
    return tuple(rows)


def _calibrated(site: Site, limits: Limits) -> StereoHead | None:
    """Return the calibrated head.

    It is None without a readable calibration, which has a row of its own.
    """
    if not site.calibration:
        return None
    try:
        return load_calibration(resolve(site.calibration)).stereo_head(limits.head)
    except UnwrinkleError:
        return None


def _row(name: str, ask: Callable[[], str]) -> DeviceRow:
    try:
        return DeviceRow(name, True, ask())
    except UnwrinkleError as error:
        return DeviceRow(name, False, str(error))


def _controller_rows(site: Site, limits: Limits, clock: Callable[[], float]) -> list[DeviceRow]:
    """Check the controller; the state server first: only its status permits a motion connection."""
    c = site.controller
    # Checked first, because the grippers need this port again, and it accepts one client at a time.
    io = _row("controller I/O", partial(_io, site))
    rows = []
    facts: ControllerFacts | None = None
    try:
        facts = listen(c, clock)
        rows.append(DeviceRow("controller state", True, f"{c.host}:{c.state_port} answers"))
    except HardwareError as error:
        rows.append(DeviceRow("controller state", False, str(error)))
    rows.append(_row("controller motion", partial(_motion, site, facts)))
    rows.append(io)
    if facts is None:
        return rows
    found = facts
    rows.append(_row("robot status", lambda: _status(found)))
    rows.append(_row("joint feedback", lambda: _feedback(site, found)))
    rows.append(_row("joint positions", lambda: _positions(site, limits, found)))
    rows.append(DeviceRow("assumptions", True, _assumptions(site)))
    return rows


def _motion(site: Site, facts: ControllerFacts | None) -> str:
    c = site.controller
    if facts is None or facts.status is None or facts.status.in_motion not in (0, 1):
        raise HardwareError(
            f"{c.host}:{c.motion_port} was not tried: it is unknown whether the controller's "
            "queues are empty, and their content would run at the next connection; check the "
            "state server first"
        )
    if facts.status.in_motion == 1:
        raise HardwareError(f"{c.host}:{c.motion_port} was not tried: {QUEUE_LEFT}")
    return reach(c, "motion", c.motion_port)


def _io(site: Site) -> str:
    if not needs_io(site.grippers):
        return "not required: no gripper is switched by the controller's outputs"
    return reach(site.controller, "I/O", site.controller.io_port)


def _assumptions(site: Site) -> str:
    """Return the controller's properties that are taken from the site, not queried."""
    c = site.controller
    still = [name for name in GROUPS if name not in c.groups_moved]
    moved = f"moves {', '.join(c.groups_moved)}" + (f", not {', '.join(still)}" if still else "")
    return (
        f"the firmware {moved}; refuses points above {c.speed_cap:g} of an axis' speed, and starts "
        f"more than {c.start_pulses:g} pulses off; answers motion within {1e3 * c.latency:.0f} ms "
        "(the first run measures this). Taken from the site: it cannot be queried"
    )


def _status(facts: ControllerFacts) -> str:
    if facts.status is None:
        raise HardwareError(
            "no ROBOT_STATUS arrived within a second; is the port that of the state server?"
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
        f"{facts.rate:.1f} sets per second of the groups {', '.join(site.controller.groups)}, "
        f"longest gap {1e3 * facts.longest_gap:.0f} ms"
    )


def _positions(site: Site, limits: Limits, facts: ControllerFacts) -> str:
    q = facts.positions
    if q is None:
        raise HardwareError("no complete set of joint positions arrived; check controller.groups")
    if not np.isfinite(q).all():
        raise HardwareError("a joint position is not a finite number; restart the controller")
    out = np.flatnonzero((q < limits.lower - 5e-3) | (q > limits.upper + 5e-3))
    if len(out):
        text = ", ".join(f"axis {i + 1}: {q[i]:.3f} rad" for i in out)
        raise HardwareError(
            f"outside the robot's limits: {text}; are the values degrees, or is the order of the "
            f"groups not {', '.join(site.controller.groups)}?"
        )
    return "within limits: " + " ".join(f"{np.degrees(value):.1f}" for value in q) + " deg"


def _grippers(site: Site, clock: Callable[[], float], sleep: Callable[[float], None]) -> str:
    g = site.grippers
    if g.kind == NO_DEVICE:
        return "this site has no grippers"
    if not needs_io(g):
        return check_grippers(g, clock, sleep)
    addresses = sorted({a for a in (*g.closed_input, *g.holding_input) if a} | set(g.close_output))
    values = read_inputs(site.controller, addresses)
    silent = [address for address, value in values.items() if value is None]
    if silent:
        raise HardwareError(
            f"the controller refuses the addresses {', '.join(map(str, silent))}; check the "
            "addresses under grippers"
        )
    return f"{g.kind}: " + ", ".join(f"{address} is {value}" for address, value in values.items())
