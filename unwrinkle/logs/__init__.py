"""Summary, replay and export of a run log."""
