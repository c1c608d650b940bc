"""Depth cameras: from a capture to the range map of the garment on the table."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
