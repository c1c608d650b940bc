"""From a flattening target to a timed dual-arm motion, and the independent check of that motion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
