"""Target to two-arm plan, and the plan's independent verification; no Drake systems.

- `plan`, `trajectory`: the results, as values.
- `search/`: the seven poses, inverse kinematics along them, a collision-free motion, transits.
- `timing/`: time parameterisation within limits of velocity, acceleration and jerk.
- `verification/`: every limit and clearance of the samples as sent, and between them.
- `robot/`: kinematics and collision checking. `primitives/`: motions other than the pull.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
