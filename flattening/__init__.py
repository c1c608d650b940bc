"""The decisions: which wrinkle next, with how many arms, plan and verdict, or the reason to stop.

No Drake systems.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
