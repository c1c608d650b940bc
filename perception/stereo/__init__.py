"""Stereo head: rectification, dense matching and range mapping of image pairs."""
