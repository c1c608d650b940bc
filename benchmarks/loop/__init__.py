"""Benchmark `loop`: whole runs of the closed loop."""
