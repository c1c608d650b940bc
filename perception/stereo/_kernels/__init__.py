"""Compiled kernels of the dense stereo matcher."""
