"""Benchmarks of unwrinkle: `python -m benchmarks NAME` runs one from a checkout.

harness     run trials, keep their results, write reports, pages and figures
published   published experiments repeated: Tables I and II, garments, grasps, sensitivity
perception  range maps, calibration, gaze, depth cameras, masks, real captures
planning    flattening plans, and ways to time a path
cloth       the simulated cloth against closed forms
loop        whole runs of `unwrinkle flatten`
parity      one plan simulated, through the drivers, and from the run log

The fault catalogue and the soak are test code: `tests/robustness`.
"""
