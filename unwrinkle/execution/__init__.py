"""Execution of a saved plan on a robot.

- `session`: one call of `unwrinkle execute`: connect, check, ask the operator, run.
- `robot`: the same for programs (`uw.connect`).
- `preflight`, `posture`: checks before anything moves.
- `confirmation`: the plan's hash, typed by the operator.
- `executor`: steps `unwrinkle.flattening.execution` with the devices of a site.
- `loop`, `controls`, `page`: the operator: hold, resume, stop, speed, dead-man key.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
