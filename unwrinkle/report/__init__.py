"""Report and replay of a run."""
