"""Perception as Drake systems."""
