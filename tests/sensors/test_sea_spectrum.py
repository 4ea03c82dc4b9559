"""The JONSWAP spectrum against what its paper says of its peak."""

import numpy as np
import pytest

from sensors.sea_spectrum import jonswap

FREQUENCIES = np.linspace(0.0, 0.5, 5001)  # [Hz]


def enhanced(relative: float, enhancement: float) -> float:
    """Over a sea without a raised peak, at a share of the peak's frequency."""
    with_peak, without = (
        jonswap(np.array([0.1 * relative]), peak_frequency=0.1, peak_enhancement=each)
        for each in (enhancement, 1.0)
    )
    return float(with_peak[0] / without[0])


@pytest.mark.parametrize("enhancement", [1.0, 3.3, 7.0])
def test_the_peak_is_raised_by_its_enhancement_and_nothing_far_from_it(enhancement: float) -> None:
    assert enhanced(1.0, enhancement) == pytest.approx(enhancement)
    assert enhanced(0.5, enhancement) == pytest.approx(1.0, abs=1e-6)
    assert enhanced(2.0, enhancement) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("one_width_off", [1.0 - 0.07, 1.0 + 0.09])
def test_the_raised_peak_is_a_bell_that_is_wider_above_than_below(one_width_off: float) -> None:
    assert np.log(enhanced(one_width_off, 3.3)) / np.log(3.3) == pytest.approx(np.exp(-0.5))


def test_a_sea_is_highest_at_its_peak_and_falls_with_the_fifth_power() -> None:
    sea = jonswap(FREQUENCIES, peak_frequency=0.1, peak_enhancement=1.0)
    assert FREQUENCIES[np.argmax(sea)] == pytest.approx(0.1)
    assert sea[0] == 0.0
    high = jonswap(np.array([10.0, 20.0]), peak_frequency=0.1, peak_enhancement=3.3)
    assert high[0] / high[1] == pytest.approx(2.0**5)


def test_frequencies_may_have_any_unit() -> None:
    hertz = jonswap(FREQUENCIES, peak_frequency=0.1, peak_enhancement=3.3)
    millihertz = jonswap(1e3 * FREQUENCIES, peak_frequency=100.0, peak_enhancement=3.3)
    assert millihertz == pytest.approx(hertz)
