"""Controls of the station's loopback form.

- `controls`: the real drivers, over TCP and serial lines, connected to virtual devices.
- `virtual_devices`: these, as Drake systems. `lockstep`: both ends on the simulation's clock.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
