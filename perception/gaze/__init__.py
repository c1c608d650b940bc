"""Gaze of the head: vergence on a point, localisation in an image, visual search."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
