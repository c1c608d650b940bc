"""Layers and folds of a garment, and its state by them.

- `garment_state`: flat, wrinkled, folded or crumpled, not seen well enough.
- `learn_garment`: flat area, outline and thickness of a garment, from a look at it flat.
- `borders`: lines where one layer of cloth ends on another.
- `flaps`: folded parts, by the known outline or by borders.
- `ridge_kinds`: ridges that are no wrinkles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
