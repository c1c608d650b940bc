"""Robot, cell, limits and sites as typed data; the values, errors and files that all else uses.

- `data/`: model files: URDF, SDF, YAML, captures.
- `robot`, `scenario`, `site`: schemas of the cell, of its settings, and of a laboratory's devices.
- `table`, `transforms`, `arrays`, `choices`, `errors`: shared values.
- `io/`: typed YAML, archives of arrays, files written whole or not at all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
