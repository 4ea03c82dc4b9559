"""What an AC-coupled sensor leaves of slow motion."""

import numpy as np
import pytest

from sensors.structure.ac_coupling import ChannelCoupling


@pytest.mark.parametrize("corner", [0.05, 0.5])
def test_at_its_corner_a_sensor_reads_the_root_of_a_half_and_of_a_rest_nothing(
    corner: float,
) -> None:
    coupling = ChannelCoupling(np.array([corner, 0.0]), 40.0)
    coupled, direct = np.abs(coupling.gain(np.array([0.0, corner, 100 * corner]))[:, :, 0]).T
    np.testing.assert_allclose(coupled[:2], [0.0, np.sqrt(0.5)], atol=1e-12)
    if corner < 0.1:
        assert coupled[2] == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(direct, 1.0)
