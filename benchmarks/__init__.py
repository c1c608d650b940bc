"""Benchmarks: each public module but `report` is one, run by ``unwrinkle bench NAME``."""
