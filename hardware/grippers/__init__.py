"""Drivers of the grippers.

A new gripper is a class with the interface of `base.Grippers`, like `can_bus` or `digital_io`, and
a line in `factory`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
