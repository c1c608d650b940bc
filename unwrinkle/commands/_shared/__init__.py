"""Options and steps shared by several commands."""
