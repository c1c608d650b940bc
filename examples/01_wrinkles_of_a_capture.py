"""From a depth capture to the wrinkles of a garment, largest first.

Run: python examples/01_wrinkles_of_a_capture.py
"""

from unwrinkle.models.robot import load_cell, model_file
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.wrinkles.analysis import analyse

cell = load_cell()
capture = load_capture(model_file("captures/towel.npz"))
range_map = range_map_from_capture(
    capture, centre=cell.scenario.garment_centre, table_height=cell.table.height
)
analysis = analyse(range_map, table=cell.table, mode="foot")

for wrinkle in analysis.wrinkles:
    x, y = wrinkle.centre
    print(
        f"wrinkle at ({x:+.3f}, {y:+.3f}) m: {1e3 * wrinkle.length:.0f} mm long, "
        f"{1e3 * wrinkle.peak_height:.1f} mm high, "
        f"pull {1e3 * wrinkle.pull_distance('foot'):.1f} mm"
    )
print("flat" if analysis.flat else "not flat yet")
