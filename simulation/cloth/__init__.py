"""Cloth simulation: XPBD solver, garments, initial states, shape measures."""
