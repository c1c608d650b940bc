"""Photograph a towel with both eyes of the simulated head; make the range map; find its wrinkles.

Run: python examples/04_range_map_of_a_pair.py [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from unwrinkle.models.robot import load_cell
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.runs.pictures import save_pictures
from unwrinkle.simulation.rendering.image_noise import photograph_pair
from unwrinkle.simulation.rendering.meshes import towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "pair")
folder.mkdir(exist_ok=True)

# The cell with a towel on its table; the head looks at the towel's centre.
towel = wrinkled_towel(seed=7)
cell = load_cell()
renderer = Renderer(cell, [towel_mesh(towel)])
head = nominal_head()
gaze = head.gaze_at(np.array([*towel.centre, towel.table_height]))
X_WL, X_WR = head.poses(gaze)
eyes = (head.left.camera, X_WL, head.right.camera, X_WR)
left, right = photograph_pair(renderer, eyes, seed=0, scale=0.5)  # 4 megapixels: quicker
for name, image in (("left", left), ("right", right)):
    cv2.imwrite(str(folder / f"{name}.png"), image[..., ::-1])

# Pair and angles in, heights above the table out.
range_map = range_map_from_pair(StereoPair(left, right), head, gaze, table=cell.table)
analysis = analyse(range_map, table=cell.table)
save_pictures(folder, analysis, analysis.wrinkledness, title="pair")
print(f"map of {range_map.shape[1]} x {range_map.shape[0]} cells of {range_map.resolution} m")
for wrinkle, ridge in zip(analysis.wrinkles, towel.ridges, strict=False):
    print(
        f"wrinkle {1e3 * wrinkle.width:.1f} mm wide, {1e3 * wrinkle.peak_height:.1f} mm high "
        f"(true ridge: {2e3 * ridge.sigma:.1f} mm wide, {1e3 * ridge.height:.1f} mm high)"
    )
