"""The log of a run: what was sent and measured."""
