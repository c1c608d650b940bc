"""Faults that can be injected into the virtual controller."""
