"""Numba kernels of the XPBD cloth solver."""
