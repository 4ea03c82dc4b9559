"""A unit's clock is judged by its stamps against its sample count."""

import numpy as np
import pytest

from pipeline.oma.windows.unit_clock import ClockFit, at_nominal_rate, fit_clock
from sensors.acquisition.blocks import NANOSECONDS

RATE = 40.0  # [Hz]


def stamps(drift: float, jitter: float, *, late: int = 0) -> list[tuple[int, int]]:
    """Of ten minutes of blocks of a second; `late` of them come a second late."""
    generator = np.random.default_rng(3)
    seconds = np.arange(600) * (1 + drift) + jitter * generator.standard_normal(600)
    seconds[generator.permutation(600)[:late]] += 1.0
    return [(round(40 * k), round(s * NANOSECONDS)) for k, s in enumerate(seconds)]


def test_a_drift_is_one_where_it_is_four_times_its_standard_deviation() -> None:
    limit = 1e-5
    assert ClockFit(5e-5, drift_std=1.0e-5, scatter=0.0).exceeds(limit)
    assert not ClockFit(5e-5, drift_std=1.5e-5, scatter=0.0).exceeds(limit)
    assert not ClockFit(0.9e-5, drift_std=1e-9, scatter=0.0).exceeds(limit)


@pytest.mark.parametrize("drift", [0.0, 5e-5, -2e-4])
def test_a_few_stamps_that_are_far_off_do_not_turn_the_line(drift: float) -> None:
    found = fit_clock(stamps(drift, 1e-5, late=20), RATE)
    assert found is not None
    assert found.drift == pytest.approx(drift, abs=1e-7)
    assert found.drift_std < 1e-7


@pytest.mark.parametrize("drift", [0.0, 1e-4, -2.5e-3])
@pytest.mark.parametrize("sizes", [(0.03,), (-0.1,), (0.5, -0.4), (-7200.0,), (3.8e8, -3.8e8)])
@pytest.mark.parametrize("jitter", [0.0, 1e-3])
def test_a_clock_that_is_set_is_no_drift(drift: float, sizes: tuple[float, ...], jitter) -> None:
    """
    stamp − count   ────────┐            left in, .1 s in mid-window is a drift of 250 ppm
                            └────────
    """
    moved = stamps(drift, jitter)
    for place, size in zip((300, 450), sizes, strict=False):
        moved[place:] = [(n, t + round(size * NANOSECONDS)) for n, t in moved[place:]]
    found = fit_clock(moved, RATE)
    assert found is not None
    assert found.drift == pytest.approx(drift, abs=5e-6)
    assert abs(found.step) == pytest.approx(max(map(abs, sizes)), rel=0.05)
    assert found.scatter < 2e-3


@pytest.mark.parametrize("jitter", [0.0, 1e-3, 0.02, 0.3])
def test_scatter_and_drift_alone_are_no_step(jitter: float) -> None:
    found = fit_clock(stamps(2.5e-3, jitter), RATE)
    assert found is not None
    assert found.step == 0.0
    slow = fit_clock([(n, t + round(1e-9 * n**2)) for n, t in stamps(1e-4, 1e-4)], RATE)
    assert slow is not None  # a converter that warms up
    assert slow.step == 0.0


def test_stamps_in_coarse_units_follow_a_drift() -> None:
    coarse = [(n, round(t, -8)) for n, t in stamps(2.5e-3, 0.0)]  # tenths of a second
    found = fit_clock(coarse, RATE)
    assert found is not None
    assert found.drift == pytest.approx(2.5e-3, abs=2e-5)
    assert found.step == 0.0


@pytest.mark.parametrize("ratio", [1.0 + 1e-3, 1.0 - 1e-3])
def test_what_a_fast_or_slow_converter_took_is_read_at_the_instants_of_a_true_one(
    ratio: float,
) -> None:
    taken, true = np.arange(2000) / (ratio * RATE), np.arange(1990) / RATE
    wave = np.sin(2 * np.pi * 1.3 * taken)[:, None]
    read = at_nominal_rate(wave, ratio)
    assert len(read) == 1 + int(1999 / ratio)
    np.testing.assert_allclose(read[20:1970, 0], np.sin(2 * np.pi * 1.3 * true)[20:1970], atol=1e-3)


@pytest.mark.parametrize("started", [1, 3 * 10**10])
def test_a_line_through_stamps_is_the_same_however_long_the_unit_has_run(started: int) -> None:
    now = stamps(5e-5, 1e-4, late=3)
    later = [(number + started, stamp) for number, stamp in now]
    assert fit_clock(later, RATE) == fit_clock(now, RATE)
