"""Captures to range maps (height above the table), to wrinkles, to the hands' target; no Drake.

- `depth/`: a depth image to a range map.
- `stereo/`: a pair of the stereo head to a range map.
- `wrinkles/`: a range map to its wrinkles, their measures, grasp points and pull distances.
- `folds/`: layers and folds of the garment, and its state: flat, wrinkled, folded or crumpled.
- `calibration/`: cameras, stereo head, camera in the gripper.
- `gaze/`: vergence of the head on a point, visual search.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
