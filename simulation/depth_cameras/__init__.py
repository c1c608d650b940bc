"""Depth camera models: structured light and time of flight."""
