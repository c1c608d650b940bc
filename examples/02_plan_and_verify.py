"""A verified dual-arm plan for the largest wrinkle, and what the verification measured.

Run: python examples/02_plan_and_verify.py
"""

from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.robot import load_cell, model_file
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.target import NoTarget
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.planning.search.planner import FlatteningPlanner

cell = load_cell()
capture = load_capture(model_file("captures/towel.npz"))
range_map = range_map_from_capture(
    capture, centre=cell.scenario.garment_centre, table_height=cell.table.height
)
target = analyse(range_map, table=cell.table).target
if isinstance(target, NoTarget):
    raise SystemExit(target.reason)

found = plan_verified(FlatteningPlanner(cell), cell, target)
result, verdict = found.result, found.verdict
if verdict is None or result.failure is not None:
    raise SystemExit(result.failure.message if result.failure else "no plan")

print(verdict.summary())
for name, outcome, worst, limit, _, where in verdict.rows():
    print(f"{name:18s} {outcome:5s} {worst:>14s} {limit:>14s}  {where}")
