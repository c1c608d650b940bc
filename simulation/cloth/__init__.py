"""The simulated cloth: solver, garments, initial states, measures of its true shape."""
