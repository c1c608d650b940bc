"""Rendering: images and exact depth of the cell, textured meshes, image noise."""
