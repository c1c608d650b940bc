"""Photograph a towel with both eyes of the simulated head, and find its wrinkles in the pair.

Run: python examples/stereo_pair.py [FOLDER]
"""

import subprocess
import sys
from pathlib import Path

import unwrinkle as uw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "pair")
# Two pictures of one megapixel, and head.yaml with the angles that they were taken at.
render = ["render", "--out", str(folder), "--scale", "0.25", "--seed", "7"]
subprocess.run([sys.executable, "-m", "unwrinkle", *render], check=True)

cell = uw.load_cell()
flattener = uw.Flattener(cell)
pair = uw.load_stereo_capture(folder / "left.png", folder / "right.png", folder / "head.yaml", cell)
seen = flattener.observe(pair)
uw.save_pictures(folder, seen.analysis, flattener.choose(seen), title="pair")
for wrinkle in seen.analysis.wrinkles:
    print(f"wrinkle {1e3 * wrinkle.width:.1f} mm wide, {1e3 * wrinkle.peak_height:.1f} mm high")
