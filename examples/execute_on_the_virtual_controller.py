"""Execute a plan through the robot controller's own protocol, against a virtual controller on this
machine.

With a site file of your own in place of the shipped one the same lines run the robot, and `execute`
has to be given the plan's hash: read docs/howto/deployment.md first.

Run: python examples/execute_on_the_virtual_controller.py [LOG]
"""

import sys

import unwrinkle as uw

cell = uw.load_cell()
flattener = uw.Flattener(cell)
seen = flattener.observe(uw.load_capture(uw.model_file("captures/towel.npz")))
proposal = flattener.propose(seen)
if proposal.plan is None:
    raise SystemExit(proposal.reason)

with uw.connect("loopback", cell, log=sys.argv[1] if len(sys.argv) > 1 else "run.jsonl") as robot:
    for check in robot.preflight(proposal.plan).checks:
        print(f"{check.name:13s} {'pass' if check.passed else 'FAIL'}  {check.text}")
    result = robot.execute(proposal.plan)
    print(f"{result.outcome}: {', '.join(result.finished)}; log {robot.log}")
