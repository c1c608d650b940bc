"""A virtual controller with digital grippers in a process of its own; run by the tests, not
imported.

Prints its ports, takes words on standard input (e_stop, end), and prints at the end what it was
told, as JSON.
"""

import json
import os
import select
import sys
import time

import numpy as np

from unwrinkle.hardware.motoros.messages import MessageType
from unwrinkle.models.robot import load_cell
from unwrinkle.models.site import loopback_site
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer

MOTION = (
    MessageType.MOTION_CTRL,
    MessageType.JOINT_TRAJ_PT_FULL,
    MessageType.JOINT_TRAJ_PT_FULL_EX,
)
LONGEST = 120.0

options = json.loads(sys.argv[1])
limits = load_cell().limits
start = np.zeros(13)
for axis, value in options.get("start", {}).items():
    start[int(axis)] = value
controller = VirtualController(
    VirtualControllerSettings(), start, (limits.lower, limits.upper, limits.velocity)
)
server = ControllerServer(controller)
print(json.dumps(server.ports), flush=True)
site = loopback_site().grippers
strokes = [(False, 0.0), (False, 0.0)]
for address in (*site.closed_input, *site.holding_input):
    controller.inputs[address] = 0
end = time.monotonic() + LONGEST
while (now := time.monotonic()) < end:
    server.poll(now)
    for side, output in enumerate(site.close_output):
        closed = output in controller.outputs and (
            bool(controller.outputs[output]) != site.inverted[side]
        )
        if closed != strokes[side][0]:
            strokes[side] = (closed, now)
        if now - strokes[side][1] > 0.2:
            controller.inputs[site.closed_input[side]] = int(closed)
            holding = closed and side != options.get("misses")
            controller.inputs[site.holding_input[side]] = int(holding)
    if select.select([0], [], [], 0.001)[0]:
        said = os.read(0, 100).split()
        if b"e_stop" in said:
            controller.pendant.press_e_stop()
        if b"end" in said or not said:
            break
server.close()
motion = [message for _, message in controller.messages if message.type in MOTION]
told = {
    "motion": len(motion),
    "points": controller.points,
    "positions": controller.positions.tolist(),
    "outputs": {str(address): value for address, value in controller.outputs.items()},
    "moving": bool(controller.moving),
}
print(json.dumps(told), flush=True)
