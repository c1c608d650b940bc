"""Array types by element; shape, unit and frame are given in the docstring of each function."""

import numpy as np
from numpy.typing import NDArray

#: Double precision: positions, angles, heights, times.
Array = NDArray[np.float64]
#: Single precision, of many elements: height maps, disparities.
Grid = NDArray[np.float32]
#: True where something holds.
Mask = NDArray[np.bool_]
#: Indices into another array.
Indices = NDArray[np.intp]
#: Pixels, (h, w) grey or (h, w, 3) RGB.
Image = NDArray[np.uint8]
#: A rigid pose X_AB, (4, 4): B in A (Drake's monogram notation).
Pose = NDArray[np.float64]
