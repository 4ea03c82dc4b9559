"""How late a unit's stamps are, by the phases of the modes that both units see."""

import numpy as np

from pipeline.oma.data_quality.clock_offsets import _fitted


def test_an_offset_lies_as_far_from_the_truth_as_it_says() -> None:
    """Twelve modes to 8 Hz, whose phases scatter by 20 mrad, in sixty windows: an rms of .68, for
    the step of the coarse grid counts as scatter."""
    omega = 2 * np.pi * np.linspace(0.5, 8.0, 12)
    generator = np.random.default_rng(4)
    apart = []
    for offset in generator.uniform(-10e-3, 10e-3, 60):
        found = _fitted(omega, omega * offset + 0.02 * generator.standard_normal(12))
        assert found is not None
        apart.append((found.seconds - offset) / found.std)
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.3
