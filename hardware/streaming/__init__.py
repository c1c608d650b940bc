"""Stream of trajectory points.

- `stream`: points sent ahead of the robot. `path_clock`, `rate_change`: hold, resume, override.
- `sent_cubics`: the cubics that the controller runs between points.
- `trajectory_check`, `firmware_limits`: refusals before anything is sent.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
