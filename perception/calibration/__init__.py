"""Calibration of stereo cameras, of the stereo head, and of a gripper camera."""
