"""Benchmark `depth_cameras`: the simulated depth cameras beside real maps."""
