"""Drake LeafSystems, thin wrappers over the functions of the other folders, and their diagrams."""
