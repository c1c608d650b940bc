"""Virtual DX100 with MotoROS: `controller` behind `server`'s three ports, and its `faults`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
