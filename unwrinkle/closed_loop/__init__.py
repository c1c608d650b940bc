"""Runs of the closed loop: setup, session, recording, progress."""
