"""Wrinkle analysis of a range map: surface, ridges, wrinkle measures, flattening targets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
