"""What stands in for the world: garments and wrinkle makers, cloth physics, rendered sensors."""
