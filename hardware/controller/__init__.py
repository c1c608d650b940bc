"""The robot controller's driver."""
