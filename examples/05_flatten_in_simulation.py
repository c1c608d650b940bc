"""Run the closed loop in the simulated cell: a towel with one ridge, looked at, pulled, and looked at again.

Run: python examples/05_flatten_in_simulation.py [FOLDER]
"""

import sys
from pathlib import Path

from unwrinkle.closed_loop.session import Choices, begin

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "run")

# What is left out comes from the shipped scenario. One megapixel is enough for a single ridge.
session = begin(Choices(start="ridge", seed=1, scale=0.25, actions=4), None, folder)
ending = session.run()
print(f"{ending.status}: {ending.reason}")

# The folder holds everything that was seen, planned, verified and done; report.html and replay.html show it.
for look in session.folder.looks():
    action = look.action()
    truth = action.truth_before or {}
    print(
        f"look {look.index + 1}: true height {1e3 * truth['height']:.1f} mm, {action.outcome}"
        + "".join(f", {arm} arm {1e3 * pull:.1f} mm" for arm, pull in action.pulls.items())
    )
    if action.outcome == "done":
        verdict = look.verdict()
        assert verdict["passed"] and verdict["plan_hash"] == look.plan().content_hash
