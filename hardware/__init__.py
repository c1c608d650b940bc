"""Drivers of the robot's devices: controller, grippers, cameras, pan-tilt units."""
