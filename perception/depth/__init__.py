"""Depth cameras: from a capture to the range map of the garment on the table."""
