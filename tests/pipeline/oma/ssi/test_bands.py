"""Bands of a record: their filters, and what a high pass brings to light."""

import math
import re

import numpy as np
import pytest
from scipy import signal

from pipeline.oma.identification import identify
from pipeline.oma.preprocessing import (
    HIGH_PASS_BAND,
    HIGH_STOP_BAND,
    decimated,
    high_pass_taps,
    n_decimated,
)
from pipeline.oma.settings import HIGHEST_RELATIVE, OmaSettings
from pipeline.oma.ssi.bands import Band, _orders, plan_bands
from pipeline.scenario import scenario_from_text
from tests.pipeline.oma.conftest import KnownStructure

RATE = 40.0


@pytest.mark.parametrize("decimation", [1, 4, 8])
def test_the_length_of_a_bands_record_is_known_beforehand(decimation: int) -> None:
    for n in (10, 97, 1000, 4321):
        band = decimated(np.ones((n, 2)), decimation)
        assert len(band) == n_decimated(n, decimation)


def test_the_high_pass_is_flat_shut_and_symmetric() -> None:
    taps = high_pass_taps()
    f, response = signal.freqz(taps, worN=4096, fs=1.0)
    assert np.abs(response[f >= HIGH_PASS_BAND]) == pytest.approx(1.0, abs=2e-3)
    assert np.abs(response[f <= HIGH_STOP_BAND]).max() < 2e-3
    assert taps.sum() == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-15)


def test_a_window_has_slow_bands_and_a_short_one_only_what_it_carries() -> None:
    whole = plan_bands(n_samples=24_000, n_channels=8, sampling_rate=RATE, settings=OmaSettings())
    assert [(band.decimation, band.high_passed) for band in whole] == [
        (8, False), (8, True), (4, False), (4, True), (1, False), (1, True),
    ]  # fmt: skip
    assert {int(each) for band in whole for each in np.diff(band.orders)} == {4}  # two modes more
    assert [(band.orders[0], band.orders[-1]) for band in whole] == [
        (16, 60), (16, 60), (16, 48), (24, 80), (20, 68), (40, 108),
    ]  # fmt: skip
    short = plan_bands(n_samples=300, n_channels=8, sampling_rate=RATE, settings=OmaSettings())
    assert not short[0].high_passed
    assert all(band.decimation == 1 for band in short)


def planned(rate: float, duration: float = 600.0) -> tuple[Band, ...]:
    n = round(duration * rate)
    return plan_bands(n_samples=n, n_channels=8, sampling_rate=rate, settings=OmaSettings())


@pytest.mark.parametrize("rate", [*np.geomspace(20.0, 2000.0, 41), 40.001, 41.001, 82.001, 128.0])
def test_the_bands_reach_a_towers_modes_at_every_rate_without_a_gap(rate: float) -> None:
    """As at 40 Hz: the slowest hold a period of .04 Hz and are free of what lies below .51 Hz at
    most, so that a second bending mode at .6 Hz is in them, and each band begins where lower ones
    still reach."""
    bands = planned(rate)
    slowest = [band for band in bands if band.decimation == bands[0].decimation]
    assert [band.high_passed for band in slowest] == [False, True]
    assert slowest[0].lowest < 0.041
    assert slowest[1].lowest < 0.52
    reached = 0.0
    for band in bands:
        assert band.lowest < max(reached, 0.041)
        reached = max(reached, band.highest)
    for band, next_band in zip(bands[1::2], bands[3::2], strict=False):  # free of what lies below
        assert next_band.lowest < band.highest
    assert reached == pytest.approx(HIGHEST_RELATIVE * rate)
    assert len(bands) <= 6 + 2 * math.ceil(math.log(max(rate / 41.0, 1.0), 3))


def test_a_clock_that_runs_fast_changes_no_band() -> None:
    assert [b.decimation for b in planned(40.0)] == [b.decimation for b in planned(40.04)]


def test_a_mode_beside_a_much_stronger_sea_is_found(cantilever: KnownStructure) -> None:
    """Swell at .1 to .3 Hz, three hundred times as strong as the modes."""
    y = cantilever.ambient_response(
        sampling_rate=RATE, duration=600.0, seed=31, noise=0.0, excitation=[1.0, 0.3, 1.0]
    )
    generator = np.random.default_rng(32)
    sections = signal.butter(8, [0.1, 0.3], "bandpass", fs=RATE, output="sos")
    sea = signal.sosfilt(sections, generator.standard_normal((len(y), 3)), axis=0)
    levels = np.linspace(0.2, 1.0, y.shape[1]) ** np.arange(1, 4)[:, None]
    record = y + 300 * sea / sea.std(axis=0) @ levels
    record += 0.05 * generator.standard_normal(record.shape)
    modes = identify(record, RATE).modes
    for frequency in cantilever.frequencies[1:]:
        assert min(abs(mode.frequency / frequency - 1) for mode in modes) < 0.01


def test_a_lower_frequency_asked_for_gains_a_slower_band() -> None:
    def lowest(text: str) -> float:
        settings = scenario_from_text(text, "own.toml").oma
        bands = plan_bands(n_samples=400_000, n_channels=4, sampling_rate=RATE, settings=settings)
        return min(band.lowest for band in bands)

    reached = lowest("")
    assert lowest(f"[oma]\nlowest_frequency = {reached / 3}\n") == pytest.approx(reached / 3)
    assert lowest("[oma]\nlowest_frequency = 3.0\n") == 3.0


@pytest.mark.parametrize("lowest", np.geomspace(0.002, 0.2, 25))
def test_the_slowest_band_holds_a_period_of_the_lowest_frequency_and_is_no_slower(lowest) -> None:
    settings = OmaSettings(lowest_frequency=lowest)
    bands = plan_bands(n_samples=10**7, n_channels=4, sampling_rate=RATE, settings=settings)
    slowest = max(bands, key=lambda band: band.decimation)
    periods = 2 * slowest.block_rows / slowest.sampling_rate * lowest
    assert periods >= 1.0
    assert slowest.decimation == 8 or periods < 4.0  # the next faster one would not hold it


@pytest.mark.parametrize(
    ("rank", "orders"), [(64, (20, 32)), (40, (20,)), (38, (18,)), (18, (8,)), (7, (2,)), (3, (2,))]
)
def test_an_order_is_even_and_at_most_half_the_rank(rank: int, orders: tuple[int, ...]) -> None:
    assert _orders((20, 32), rank=rank, n_references=8) == orders


def test_two_references_have_half_the_orders_of_eight() -> None:
    assert _orders((20, 32), rank=64, n_references=2) == (10, 16)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        (OmaSettings(highest_frequency=0.1), "highest_frequency is 0.1 Hz: nothing .* below 0.1 "),
        (OmaSettings(highest_frequency=0.001), "highest_frequency is 0.001 Hz: nothing .* below"),
        (OmaSettings(lowest_frequency=19.99), "lowest_frequency is 19.99 Hz: nothing .* above 18 "),
        (OmaSettings(lowest_frequency=0.01, highest_frequency=0.02), "highest_frequency is 0.02"),
    ],
)
def test_a_window_that_reaches_none_of_the_frequencies_is_rejected(
    settings: OmaSettings, why: str
) -> None:
    noise = np.random.default_rng(5).standard_normal((2400, 2))
    found = identify(noise, RATE, settings)
    assert found.rejection is not None
    assert found.rejection.code == "no-band"
    assert re.search(why, found.rejection.text)
