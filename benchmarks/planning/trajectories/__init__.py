"""Benchmark `trajectories`: ways to time a path under jerk limits."""
