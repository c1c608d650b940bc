"""How a controller runs a trajectory."""
