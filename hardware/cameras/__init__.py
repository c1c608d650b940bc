"""Drivers of the head's cameras and of the depth camera.

A new camera is a class with the interface of `base.PairCamera`, like `folder`, `opencv` or
`gphoto`, and a line in `factory`. `openni` is the depth camera.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
