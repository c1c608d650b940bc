"""Drivers of the head's pan-tilt units."""
