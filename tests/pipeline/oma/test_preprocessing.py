"""What is missing for a moment is predicted from what lies around it; what is missing for long ends
the window."""

import numpy as np
import pytest

from pipeline.oma.data_quality.input_checks import check_samples
from pipeline.oma.preprocessing import filled
from tests.pipeline.oma.conftest import KnownStructure

RATE = 20.0  # [Hz]


@pytest.fixture
def record(two_mass_system: KnownStructure) -> np.ndarray:
    return two_mass_system.ambient_response(sampling_rate=RATE, duration=300.0, seed=9)


@pytest.mark.parametrize(("share", "action"), [(0.04, "mend"), (0.06, "reject")])
def test_of_a_channel_a_twentieth_may_be_missing(
    record: np.ndarray, share: float, action: str
) -> None:
    gone = np.random.default_rng(1).permutation(len(record))[: round(share * len(record))]
    record[gone, 1] = np.nan
    finding = check_samples(record, RATE, ["z41", "z145"])[0]
    assert finding.action == action


def test_what_is_filled_in_goes_with_a_sensors_offset(record: np.ndarray) -> None:
    """An accelerometer that stands askew reads a share of gravity all the time."""
    record -= record.mean(axis=0)
    gaps = np.random.default_rng(2).permutation(len(record))[:100]
    record[gaps, 0] = np.nan
    offset = 3.0
    np.testing.assert_allclose(filled(record + offset, RATE), filled(record, RATE) + offset,
                               atol=1e-6)  # fmt: skip
