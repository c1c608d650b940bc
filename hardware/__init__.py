"""Drivers that speak the robot's real protocols: controller, pan-tilt units, cameras, grippers."""
