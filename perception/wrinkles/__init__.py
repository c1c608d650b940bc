"""Range map to wrinkles and to the hands' target.

- `analysis`: all of it, in order.
- `hole_filling`, `bspline`, `surface`: the smooth surface and its shape index.
- `ridges`, `cross_section`, `wrinkle`: wrinkles with width, height, volume, pull distance (Eq. 5).
- `targeting`: grasp points, directions and pull distance of both hands.
- `wrinkledness`, `grasp_proposal`: the wrinkledness measure and a grasp across a ridge.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
