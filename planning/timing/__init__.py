"""Time parameterisation of paths within velocity, acceleration, jerk and tip speed limits.

- `path_timing`: curved paths, in two stages:
  `toppra_profile` (velocity, acceleration, tip speed), then jerk by `optimal_smoothing` or
  `ruckig_smoothing`.
- `straight_lines`: straight joint lines, by ruckig.
- `sampling`: samples whose limits still hold as the controller receives them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
