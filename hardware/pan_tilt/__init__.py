"""Driver of the head's pan-tilt units, on a serial line."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
