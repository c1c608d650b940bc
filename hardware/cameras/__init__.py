"""Drivers of the head's cameras and of the depth camera."""
