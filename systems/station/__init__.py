"""The station in its three forms: simulated, loopback, hardware."""
