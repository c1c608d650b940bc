from .controls import loopback_controls as loopback_controls
