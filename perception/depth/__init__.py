"""Depth image to range map.

- `capture`: the image with its camera and pose, read from a file.
- `range_mapping`: heights above the table on a metric grid.
- `table_plane`: the table's plane. `table_choice`: which plane that is. `table_crop`: its window.
- `segmentation`: the garment. `pieces`: other things in view.
- `depth_units`: units of stored depth. `flying_pixels`: readings that are none.
- `color_registration`: colour of a camera beside the depth camera.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
