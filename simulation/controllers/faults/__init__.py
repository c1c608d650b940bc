"""Faults that the virtual controller can be told to show."""
