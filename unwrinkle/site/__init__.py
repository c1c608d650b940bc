"""A laboratory's devices: found, connected, checked."""
