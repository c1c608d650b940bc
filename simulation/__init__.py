"""What stands in for the world.

- `cloth/`: simulated garments. `rendering/`, `depth_cameras/`: pictures of them.
- `controllers/`: the virtual robot controller. `devices/`: virtual grippers, pan-tilt units.
- `arms/`: how a controller runs a trajectory.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
