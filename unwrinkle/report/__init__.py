"""The report and the replay of a run."""
