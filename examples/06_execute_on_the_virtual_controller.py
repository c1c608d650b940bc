"""Run a plan through the robot controller's own protocol, against a virtual controller on this machine.

With a site file of your own in place of the shipped one the same lines run the robot: read docs/deployment.md first.

Run: python examples/06_execute_on_the_virtual_controller.py [LOG]
"""

import dataclasses as dc
import re
import subprocess
import sys
import time
from pathlib import Path

from unwrinkle.execution.executor import PlanExecutor
from unwrinkle.execution.preflight import preflight
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.robot import model_file
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.target import NoTarget
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.site.equipment import connected
from unwrinkle.site.sites import find_site, site_cell

log_file = Path(sys.argv[1] if len(sys.argv) > 1 else "run.jsonl")
site = find_site("loopback")
cell = site_cell(site)
capture = load_capture(model_file("captures/towel.npz"))
range_map = range_map_from_capture(
    capture, centre=cell.scenario.garment_centre, table_height=cell.table.height
)
target = analyse(range_map, table=cell.table).target
if isinstance(target, NoTarget):
    raise SystemExit(target.reason)
plan = FlatteningPlanner(cell).plan(target).plan
assert plan is not None

# The controller is a program of its own; it says which ports it has taken.
controller = subprocess.Popen(
    [sys.executable, "-m", "unwrinkle", "controller", "--ports", "0,0,0", "--seconds", "120"],
    stdout=subprocess.PIPE,
    text=True,
)
assert controller.stdout is not None
said = re.search(r"motion (\d+), state (\d+), I/O (\d+)", controller.stdout.readline())
assert said is not None
motion, state, io = map(int, said.groups())
ports = {"motion_port": motion, "state_port": state, "io_port": io}
site = dc.replace(site, controller=dc.replace(site.controller, **ports))

try:
    with (
        RunLog.create(log_file, {"site": site.name, "plan_hash": plan.content_hash}) as log,
        connected(site, cell, log) as equipment,
    ):
        driver, clock = equipment.driver, equipment.clock
        equipment.settle()
        report = equipment.gripper_report()
        checked = preflight(
            plan, cell, site, *equipment.fresh_feedback(), grippers=report, log=log_file
        )
        for check in checked.checks:
            print(f"{check.name:13s} {'pass' if check.passed else 'FAIL'}  {check.text}")
        if not checked.passed:
            raise SystemExit(checked.summary())
        executor = PlanExecutor(driver, equipment.grippers, plan, speed=checked.speed, log=log)
        while (
            executor.result is None
        ):  # executor.hold(), resume(), stop() and set_speed() at any time
            executor.poll(clock())
            time.sleep(0.02)
    print(f"{executor.result.outcome} {executor.result.reason}: {executor.result.finished}")
finally:
    controller.terminate()

records = read_run_log(log_file)
print(f"{len(records.commanded.times)} points sent, {len(records.measured.times)} sets of feedback")
