"""Folder of a run and its records."""
