"""Perception: images and depth to range map, wrinkles and flattening target; no Drake."""
