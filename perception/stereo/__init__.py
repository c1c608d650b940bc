"""Pair of the stereo head to range map.

- `head`, `head_file`: the head's geometry and its files. `pair`: two images.
- `epipolar`, `rectification`: the pair against the head's angles.
- `matching`: dense disparity; its compiled kernels in `_kernels/`. `speckle`: outliers.
- `range_mapping`, `heights`, `table_view`: disparity to heights above the table.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
