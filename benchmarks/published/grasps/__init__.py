"""Benchmark `grasps`: pinches at the point of highest wrinkledness."""
