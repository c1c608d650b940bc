"""Search for a collision-free two-arm motion.

- `planner`: a target to a plan, or the reason why there is none (`failure`).
- `motion_search`, `hand_paths`, `key_poses`: the seven poses and the freedoms of the search.
- `transit`: motions from the start and to home. `assembly`: samples on one clock.
- `settings`: of all of it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
