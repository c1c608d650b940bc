"""Drivers of the grippers."""
