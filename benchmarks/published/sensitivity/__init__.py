"""Benchmark `sensitivity`: the loop with one setting changed at a time."""
