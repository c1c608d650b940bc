"""Wrinkle analysis of a range map: surface, ridges, wrinkle measures, flattening targets."""
