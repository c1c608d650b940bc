"""Benchmark `cloth`: the simulated cloth against closed forms."""
