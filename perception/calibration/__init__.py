"""Calibration of stereo cameras, of the stereo head, and of a gripper camera."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
