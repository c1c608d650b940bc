"""Run a site's virtual controller in a separate process, to rehearse without a robot.

`python -m unwrinkle.site.virtual_process SITE_FILE_OR_NAME` serves until its standard input is
closed, and prints its ports as one line of JSON: motion, state and I/O.
"""

import dataclasses as dc
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import Site
from unwrinkle.site.sites import find_site, site_cell

#: Maximum time for the process to start, s: it loads the robot's limits.
_START_TIMEOUT = 60.0
#: Maximum time for the process to end, s.
_END_TIMEOUT = 5.0


@contextmanager
def virtual_controller(name: str) -> Iterator[Site]:
    """Run the virtual controller of a site while the block runs.

    Args:
        name: shipped site, or site file; its equipment must be virtual.

    Yields:
        The site with the controller's ports; they are free ones, so that several programs can
        rehearse at once.

    Raises:
        InputError: the site's equipment is not virtual.
        HardwareError: the controller does not start.
    """
    site = find_site(name)
    if not site.virtual:
        raise InputError(
            f"site {name}: its equipment is not virtual; use site loopback to rehearse"
        )
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        motion, state, io = _ports_of(process)
        place = dc.replace(site.controller, motion_port=motion, state_port=state, io_port=io)
        yield dc.replace(site, controller=place)
    finally:
        if process.stdin is not None:
            process.stdin.close()
        try:
            process.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _ports_of(process: "subprocess.Popen[str]") -> tuple[int, int, int]:
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], _START_TIMEOUT)
    line = process.stdout.readline() if ready else ""
    try:
        motion, state, io = json.loads(line)
    except ValueError:
        raise HardwareError(
            f"the virtual controller did not start within {_START_TIMEOUT:g} s; run `unwrinkle "
            "controller` for the reason"
        ) from None
    return int(motion), int(state), int(io)


def _serve(name: str) -> None:
    from unwrinkle.site.virtual_equipment import VirtualEquipment

    site = find_site(name)
    cell = site_cell(site)
    equipment = VirtualEquipment(
        site, cell.with_speed(1.0).limits, cell.robot.named_states["home"], ports=(0, 0, 0)
    )
    try:
        print(json.dumps(equipment.server.ports), flush=True)
        wait = 0.5 * equipment.controller.settings.period
        while True:
            equipment.step(time.monotonic())
            equipment.server.wait(wait)
            readable, _, _ = select.select([sys.stdin], [], [], 0.0)
            if readable and not os.read(
                sys.stdin.fileno(), 1
            ):  # the parent has closed it or has ended
                return
    finally:
        equipment.close()


if __name__ == "__main__":
    _serve(sys.argv[1])
