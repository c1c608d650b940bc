"""unwrinkle: planning and verification of two-arm garment flattening.

    import unwrinkle as uw

    cell = uw.load_cell()
    flattener = uw.Flattener(cell)
    seen = flattener.observe(uw.load_capture("depth.png", camera="xtion-pro-live"))
    proposal = flattener.propose(seen)

The names of this package and of its subpackages are imported on first use.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = version("unwrinkle")
