"""The array types of every signature, one name a kind of number; linear algebra in one thread."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]  # positions in another array
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
RealArray = NDArray[np.floating]  # of either precision


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Use one thread in numpy's and scipy's linear algebra: small matrices are faster so, and sums
    do not depend on how many cores there are, hence neither do results."""
    import scipy.linalg  # noqa: F401  # has a BLAS of its own: what is not loaded is not limited
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        yield
