"""One executor of a plan, for `unwrinkle execute`, programs and the closed loop; no clock, no I/O.

- `executor`: the next state from the present one, the robot's feedback and the operator's wishes.
- `state`: its values: feedback, wishes, commands, state, result.
- `steps`: segments and gripper strokes of a plan in order, and the way back from a missed grasp.
- `settings`: tolerances, deadlines and reactions, made from a site.
- `retreat`: the time reversal of the verified approach.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
