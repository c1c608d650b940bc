"""Execution of a saved plan on a robot."""
