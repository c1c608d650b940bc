"""Virtual grippers and pan-tilt units."""
