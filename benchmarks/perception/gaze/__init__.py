"""Benchmark `gaze`: gaze, vergence and visual search in the rendered cell."""
