"""Drake LeafSystems around the functions of the other folders.

- `diagram`: station, perception, analysis, planner, verification and supervisor, wired.
- `supervisor`: the one system with a state machine (`unwrinkle.flattening.state_machine`).
- `perception/`, `planning/`: functions on demand (`function_system`).
- `station/`: the world behind one set of ports: simulated, loopback, hardware.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
