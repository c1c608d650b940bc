"""Drivers that speak the devices' protocols, and the run log; no Drake.

- `motoros/`: the controller's protocol: messages, TCP connections, channels.
- `streaming/`: trajectory points along the path, changes of rate, checks before sending.
- `controller/`: the controller's driver.
- `grippers/`, `cameras/`, `pan_tilt/`: an interface (`base`), one module a backend, and a registry.
- `equipment`: the devices of a site, connected for the duration of a block.
- `run_log/`: what was sent and measured.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
