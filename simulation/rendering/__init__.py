"""Rendered pictures of the cell and of known shapes."""
