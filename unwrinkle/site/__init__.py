"""A laboratory's devices: found, connected, checked; virtual ones started."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
