"""From a depth camera's capture to a range map of the garment on the table."""
