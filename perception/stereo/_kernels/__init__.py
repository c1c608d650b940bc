"""Numba kernels of the dense stereo matcher."""
