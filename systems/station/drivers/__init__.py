"""Device drivers as Drake systems."""
