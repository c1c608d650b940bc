"""The shipped cell's working table, for scenes that are made without a robot."""

from unwrinkle.models.table import Table

TABLE = Table((0.0, -1.2), (0.8, 0.8), 0.70)
#: World x, y where such scenes have the garment's centre, m.
GARMENT_CENTRE = (0.0, -1.10)
