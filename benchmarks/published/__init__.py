"""Published experiments, repeated in simulation."""
