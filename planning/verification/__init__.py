"""Independent verification of a plan against the model of the cell."""
