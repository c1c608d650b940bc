"""Planner and verification as Drake systems."""
