"""Search for a collision-free two-arm motion, and its assembly into a plan."""
