"""Benchmark `folds`: state, flaps and ridges of simulated garments, beside the true cloth."""
