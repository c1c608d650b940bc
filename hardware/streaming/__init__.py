"""The stream of trajectory points: clock along the path, changes of rate, checks before sending."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
