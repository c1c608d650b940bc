"""MotoROS' protocol.

- `tcp_link`: bytes out to the controller, and in.
- `messages` with `frames`, `codes`, `numbers`: bytes to values and back.
- `motion_channel`, `io_channel`, `start_sequence`: requests and their answers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
