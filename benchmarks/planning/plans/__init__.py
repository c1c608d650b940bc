"""Benchmark `plans`: dual-arm plans on a fixed, seeded set of targets."""
