"""Driver of the robot controller.

- `base`: its interface, `Driver`.
- `driver`: its states and commands. `driver_loop` polls it, in the process that `process` starts;
  `proxy` is what a program commands; a `MessagePipe` is between them.
- `connections`, `motion`, `preconditions`, `monitor`, `feedback`: its parts.
- `lock`: one program at a time. `clear_queue`: empties what a dead connection left behind.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
