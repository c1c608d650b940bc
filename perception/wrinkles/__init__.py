"""From a range map to wrinkles and a flattening target: surface, ridges, measures, grasp points."""
