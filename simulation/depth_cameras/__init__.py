"""Models of depth cameras: structured light and time of flight."""
