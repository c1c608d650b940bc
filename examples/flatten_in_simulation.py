"""Run the closed loop in the simulated cell: a towel with one ridge, looked at, pulled, and looked
at again.

Run: python examples/flatten_in_simulation.py [FOLDER]
"""

import sys

import unwrinkle as uw

folder = sys.argv[1] if len(sys.argv) > 1 else "run"
# What is left out comes from the shipped scenario. One megapixel is enough for a single ridge.
ending = uw.flatten(folder, seed=1, start="ridge", scale=0.25, actions=4)
print(f"{ending.status}: {ending.reason}")
print(f"open {folder}/report.html and {folder}/replay.html")
