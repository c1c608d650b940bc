"""Ask every device of a site whether it is there and well; nothing moves.

Run: python examples/check_a_site.py SITE.site.yaml, or without an argument against a virtual
controller.
"""

import sys

import unwrinkle as uw

cell = uw.load_cell()
if len(sys.argv) > 1:
    rows = uw.check_site(uw.find_site(sys.argv[1]), cell.limits)
else:
    with uw.virtual_controller("loopback") as site:
        rows = uw.check_site(site, cell.limits)
for row in rows:
    print(f"{row.name:22s} {'ok' if row.passed else 'MISSING':8s} {row.text}")
