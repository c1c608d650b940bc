"""The rig: virtual controller, driver and run log, and the checks of what a fault leaves."""
