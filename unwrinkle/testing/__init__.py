"""Builders for tests and benchmarks."""
