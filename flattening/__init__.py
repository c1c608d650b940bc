"""The decisions of garment flattening, once; no Drake systems.

- `flattener`: the pipeline as one object: observe a capture, propose a verified plan.
- `capture_to_observation`, `observation`: captures to wrinkles and their features.
- `policy`: chooses the wrinkle to pull, the number of arms, or to stop; says what is flat.
- `wrinkle_order`: the sorting that the policy uses: largest first, or another order.
- `verified_planning`: plan, verify, else the next motion.
- `state_machine`, `state`, `transitions`: the closed loop: look, decide, plan, confirm, ask the
  operator, move.
- `execution/`: the one executor of a plan: segments, gripper strokes, every way to end.
- `messages`, `station_messages`: values at the ports of the diagram.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
