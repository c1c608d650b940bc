"""The station: the diagram's ports to the world, in three forms.

- `factory`: `make_station` makes any of them, `preconditions` are those of moving a robot.
- `base`: what they have in common. `world`: the simulated part of the first two.
- `simulated`: the trajectory player drives Drake's plant.
- `loopback/`: the real drivers, over real connections, against virtual devices.
- `hardware`: the real drivers to a site's devices (`drivers/`).
- `arm_plant`, `arm_controller`, `grippers`, `head`, `cameras`, `photographer`, `cloth`,
  `motion_log`: the simulated machines.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
