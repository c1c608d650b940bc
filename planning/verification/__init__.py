"""Independent verification of a plan against the model of the cell.

- `verifier`: all checks. `verdict`: their result, each with its margin.
- `joint_limits`: position, velocity, acceleration, jerk of every axis.
- `clearance`, `shapes`, `speed_bounds`: distances of all bodies, also between samples.
- `hands`, `tools`, `postures`, `contact`: the tools over the table and with the cloth.
- `structure`, `kinematics`: what a plan is made of; the robot's numbers against its models.
- `model`, `motion`: the cell and the motion as the verification sees them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
