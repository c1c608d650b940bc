"""Plan for grasp points of your own, at a fifth of the speed, and write the page that shows the motion.

Run: python examples/03_a_target_of_your_own.py [PAGE.html]
"""

import sys
from pathlib import Path

import numpy as np

from unwrinkle.flattening.verified_planning import plan_verified
from unwrinkle.models.robot import load_cell
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.viewer.overlay import PreviewSummary
from unwrinkle.viewer.preview import preview_page

cell = load_cell().with_speed(0.2)
left, right = np.array([1.0, 0.0]), np.array([-1.0, 0.0])  # of the robot, in the world's x, y
hands = (
    # Grasp point on the table, direction of the fingers, direction and length of the pull.
    HandTarget(np.array([-0.24, -1.10, 0.70]), left, right, 0.020),
    HandTarget(np.array([+0.24, -1.10, 0.70]), right, left, 0.020),
)
target = FlatteningTarget(
    hands=hands,
    p_WC=np.array([0.0, -1.10, 0.70]),
    wrinkle_direction=np.array([0.0, -1.0]),
    geodesic_distance=0.52,
    mode="foot",
)
found = plan_verified(FlatteningPlanner(cell), cell, target)
result, verdict = found.result, found.verdict
if result.plan is None or verdict is None:
    raise SystemExit(result.failure.message if result.failure else "no plan")
print(f"motion {result.plan.motion_time:.2f} s; {verdict.summary()}")

page = Path(sys.argv[1] if len(sys.argv) > 1 else "preview.html")
page.write_text(preview_page(result.plan, cell, PreviewSummary.of(verdict)))
print(f"open {page}")
