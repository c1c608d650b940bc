"""Ask every device of a site whether it is there and well; nothing is moved.

Without an argument a virtual controller is started and its emergency stop pressed: the robot's row says so.

Run: python examples/07_check_a_site.py [SITE]
"""

import dataclasses as dc
import re
import subprocess
import sys

from unwrinkle.models.site import Site
from unwrinkle.site.check import check_site
from unwrinkle.site.sites import find_site, site_cell


def show(site: Site) -> None:
    """Print a row per device."""
    for row in check_site(site, site_cell(site).limits):
        print(f"{row.name:22s} {'ok' if row.passed else 'MISSING':8s} {row.text}")


if len(sys.argv) > 1:
    show(find_site(sys.argv[1]))
    raise SystemExit

command = [sys.executable, "-m", "unwrinkle", "controller", "--ports", "0,0,0", "--fault", "e_stop"]
with subprocess.Popen([*command, "--seconds", "60"], stdout=subprocess.PIPE, text=True) as process:
    assert process.stdout is not None
    said = re.search(r"motion (\d+), state (\d+), I/O (\d+)", process.stdout.readline())
    assert said is not None
    motion, state, io = map(int, said.groups())
    loopback = find_site("loopback")
    ports = {"motion_port": motion, "state_port": state, "io_port": io}
    show(dc.replace(loopback, controller=dc.replace(loopback.controller, **ports)))
    process.terminate()
