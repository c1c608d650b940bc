"""From a flattening target to a timed dual-arm motion, and the independent check of that motion."""
