"""Execution of a saved plan on a robot.

- `session`: one call of `unwrinkle execute`: connect, check, ask the operator, run.
- `robot`: the same for programs (`uw.connect`).
- `preflight`, `posture`: checks before anything moves.
- `confirmation`: the plan's hash, typed by the operator.
- `executor`, `loop`, `controls`, `page`: segments in order; hold, resume, stop, speed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
