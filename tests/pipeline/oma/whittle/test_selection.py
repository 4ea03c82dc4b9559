"""Which modes a band of spectral lines holds, and which it does not."""

import numpy as np
import pytest

from pipeline.oma.whittle.fit import WhittleFit
from pipeline.oma.whittle.narrow_band import NarrowBand, WindowSpectrum
from pipeline.oma.whittle.selection import FEWEST_BAND_LINES, Needed, best_fit, strongest
from pipeline.oma.whittle.spectral_model import expected_matrices
from tests.pipeline.oma.conftest import structure
from tests.pipeline.oma.whittle.test_spectral_model import two_modes

RATE, DURATION = 10.0, 600.0  # [Hz], [s]
ANYWHERE = Needed(510.0, 690.0)  # of the lines from 0.85 to 1.15 Hz


def found_in(samples: np.ndarray) -> int:
    """Number of modes in the band about 1 Hz."""
    band = WindowSpectrum(samples - samples.mean(axis=0), RATE).band(0.85, 1.15)
    fitted = best_fit(band, ANYWHERE, most_modes=4, half_width=6.0, one_colour=True)
    return 0 if fitted is None else fitted.fit.modes.n_modes


def test_noise_has_no_mode_and_one_mode_is_one() -> None:
    known = structure([1.0], 0.01, np.array([[1.0, 0.6, -0.4]]))
    for seed in range(10):
        noise = np.random.default_rng(seed).standard_normal((round(RATE * DURATION), 3))
        assert found_in(noise) == 0
        motion = known.ambient_response(sampling_rate=RATE, duration=DURATION, seed=seed)
        assert found_in(motion + 0.05 * motion.std() * noise) == 1


def test_a_parameter_costs_half_the_logarithm_of_twice_the_lines() -> None:
    """The real and the imaginary part of each line are data (Schwarz's criterion); parameters that
    may not move cost nothing."""
    modes, _ = two_modes()
    fewer, more = (WhittleFit(modes, 100.0, np.eye(15), np.eye(15)[:, :n], True) for n in (10, 14))
    assert more.bayes_cost(50) - fewer.bayes_cost(50) == pytest.approx(2 * np.log(100))


def test_a_channel_of_velocities_moves_with_one_of_accelerations() -> None:
    """An integral lags by a quarter period; the spectrum takes that out, so shapes are real."""
    time = np.arange(round(RATE * DURATION)) / RATE
    samples = np.column_stack([np.cos(2 * np.pi * time), np.sin(2 * np.pi * time)])
    spectrum = WindowSpectrum(samples, RATE, np.array([0, 1]))
    cross = spectrum.band(0.9, 1.1).matrices[:, 0, 1]
    strongest = cross[np.argmax(np.abs(cross))]
    assert abs(strongest.imag) < 1e-9 * abs(strongest)
    assert strongest.real > 0


@pytest.mark.parametrize("half_width", [50.0, 200.0])
def test_a_mode_begins_with_the_power_that_the_lines_have_at_its_resonance(
    half_width: float,
) -> None:
    """Of q' = λ q + w the power at the resonance is S / (2π b)²; of so wide a mode, leakage takes
    less than a hundredth."""
    shape, power = np.array([1.0, -0.5]), 7.0
    lines = np.broadcast_to(power * np.outer(shape, shape) + 1e-4 * np.eye(2), (40, 2, 2))
    numbers, one = np.arange(600.0, 640.0), np.ones(40)
    band = NarrowBand(lines + 0j, numbers, one, np.ones(2), DURATION, np.zeros(2, dtype=int))
    modes = strongest(band, half_width)
    expected = expected_matrices(modes, modes.positions)[0] - modes.noise
    assert modes.shapes[:, 0] == pytest.approx(shape, rel=1e-3)
    assert expected == pytest.approx(power * np.outer(shape, shape), rel=0.01)


def test_a_band_whose_own_lines_a_rotor_took_is_not_cut_to_nothing() -> None:
    """The strongest mode lies below what is needed, of which harmonics left no line."""
    known = structure([0.3], 0.01, np.array([[1.0, 0.6, -0.4]]))
    samples = known.ambient_response(sampling_rate=RATE, duration=DURATION, seed=5)
    left = np.ones(len(samples) // 2 + 1)
    left[200:] = 0.0
    spectrum = WindowSpectrum(samples - samples.mean(axis=0), RATE, left=left)
    band = spectrum.band(0.2, 0.6)
    found = best_fit(band, Needed(240.0, 280.0), most_modes=2, half_width=2.0, one_colour=False)
    assert found is None or len(found.band.numbers) >= FEWEST_BAND_LINES
