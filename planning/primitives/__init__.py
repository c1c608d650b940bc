"""Motions other than the two-arm pull."""
