"""Calibration of cameras, of the stereo head, and of a camera in the gripper."""
