"""Benchmark `parity`: one plan on three forms of the station."""
