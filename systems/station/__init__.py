"""The station: the diagram's ports to the world, in three forms.

- `simulated`: Drake's plant and the simulated cloth.
- `loopback`: the real drivers, over real connections, against virtual devices.
- `hardware`: the real drivers to a site's devices (`drivers/`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
