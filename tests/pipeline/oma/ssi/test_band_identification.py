"""How a window is cut into the time blocks that its uncertainty comes from."""

from dataclasses import replace

import pytest

from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.band_identification import (
    band_covariances,
    block_length,
    modes_of_covariances,
)
from pipeline.oma.ssi.bands import Band
from tests.pipeline.oma.conftest import KnownStructure

BAND = Band(decimation=1, sampling_rate=40.0, lowest=0.1, highest=16.0, block_rows=10, orders=(2,))


@pytest.mark.parametrize("decimation", [1, 4, 8])
@pytest.mark.parametrize("n_samples", [24_000, 24_319, 2_400])
def test_the_time_blocks_fill_the_window_but_for_less_than_a_sample_each(
    decimation: int, n_samples: int
) -> None:
    """Shorter blocks would leave samples out; longer ones would be fewer than the stds assume."""
    settings = OmaSettings()
    band = replace(BAND, decimation=decimation)
    covered = settings.n_blocks * decimation * block_length(n_samples, band, settings)
    assert n_samples - settings.n_blocks * decimation < covered <= n_samples


def test_poles_are_of_every_order_that_the_band_asks_for(cantilever: KnownStructure) -> None:
    y = cantilever.ambient_response(sampling_rate=40.0, duration=120.0, seed=5)
    band = replace(BAND, orders=(4, 8, 12, 16, 20))
    settings = OmaSettings()
    covariances = band_covariances(y, band, settings, n_samples=len(y))
    found = modes_of_covariances(covariances, band, settings)
    assert sorted({*found.poles.orders.tolist()}) == list(band.orders)
