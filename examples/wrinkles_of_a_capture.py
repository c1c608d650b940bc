"""From a depth capture to the wrinkles of a garment, largest first.

Run: python examples/wrinkles_of_a_capture.py
"""

import unwrinkle as uw

flattener = uw.Flattener(uw.load_cell())
seen = flattener.observe(uw.load_capture(uw.model_file("captures/towel.npz")))

for wrinkle in seen.analysis.wrinkles:
    x, y = wrinkle.centre
    print(
        f"wrinkle at ({x:+.3f}, {y:+.3f}) m: {1e3 * wrinkle.length:.0f} mm long, "
        f"{1e3 * wrinkle.peak_height:.1f} mm high, pull {1e3 * wrinkle.pull_distance('foot'):.1f} "
        "mm"
    )
