"""unwrinkle: planning and verification of dual-arm garment flattening."""

from importlib.metadata import version

__version__ = version("unwrinkle")
