"""The array types of every signature: one name a kind of number."""

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]  # positions in another array
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
RealArray = NDArray[np.floating]  # of either precision
