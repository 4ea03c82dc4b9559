"""Values of Arrow's columns come out of their buffers."""

import numpy as np
import pyarrow as pa

from sensors.files.text.arrow_values import integers_of, truths_of, values_of


def test_numbers_that_are_missing_are_nan() -> None:
    column = pa.array([1.0, None, 3.0, 4.5, None])
    np.testing.assert_array_equal(values_of(column), [1.0, np.nan, 3.0, 4.5, np.nan])
    np.testing.assert_array_equal(values_of(column[1:4]), [np.nan, 3.0, 4.5])
    np.testing.assert_array_equal(values_of(column[2:4]), [3.0, 4.5])
    assert values_of(column[:0]).shape == (0,)


def test_integers_keep_every_digit_and_the_place_of_a_slice() -> None:
    column = pa.array([2**62 + 1, -3, 4])
    np.testing.assert_array_equal(integers_of(column[0:2]), [2**62 + 1, -3])
    np.testing.assert_array_equal(integers_of(column[1:]), [-3, 4])


def test_truth_values_are_those_of_a_slice_too() -> None:
    column = pa.array([True, False] * 9)
    np.testing.assert_array_equal(truths_of(column), [True, False] * 9)
    np.testing.assert_array_equal(truths_of(column[3:6]), [False, True, False])
