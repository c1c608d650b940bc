"""Plan for grasp points of your own, at a fifth of the speed, and write the page that shows the
motion.

Run: python examples/target_of_your_own.py [PAGE.html]
"""

import sys

import numpy as np

import unwrinkle as uw

cell = uw.load_cell().with_speed(0.2)
left, right = np.array([1.0, 0.0]), np.array([-1.0, 0.0])  # of the robot, in the world's x, y
hands = (
    # Grasp point on the table, direction of the fingers, direction and length of the pull.
    uw.HandTarget(np.array([-0.24, -1.10, 0.70]), left, right, 0.020),
    uw.HandTarget(np.array([+0.24, -1.10, 0.70]), right, left, 0.020),
)
target = uw.FlatteningTarget(
    hands=hands,
    p_WC=np.array([0.0, -1.10, 0.70]),
    wrinkle_direction=np.array([0.0, -1.0]),
    geodesic_distance=0.52,
    mode="foot",
)
found = uw.Flattener(cell).plan(target)
if found.plan is None or found.verdict is None:
    raise SystemExit(found.reason)
print(f"motion {found.plan.motion_time:.2f} s; {found.verdict.summary()}")

page = sys.argv[1] if len(sys.argv) > 1 else "preview.html"
uw.save_preview(page, found.plan, found.verdict, cell)
print(f"open {page}")
