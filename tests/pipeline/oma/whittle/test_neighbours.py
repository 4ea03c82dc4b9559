"""A wide mode and a sharp one on its flank, fitted together from vague poles."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode, RefusedMode
from pipeline.oma.settings import HIGHEST_RELATIVE, OmaSettings
from pipeline.oma.whittle import neighbours
from pipeline.oma.whittle.lone_modes import sharpened, with_neighbours
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import around_mode, first_mode, left_near_first
from pipeline.oma.whittle.spectral_model import expected_matrices
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import ambient

RATE = 10.0  # [Hz]
FREQUENCIES = np.array([1.0, 1.18, 2.6])  # [Hz]; the last one lies beyond the band
DAMPING = np.array([0.05, 0.005, 0.01])
SHAPES = np.array([[1.0, 0.6, -0.4], [-0.3, 1.0, 0.7], [0.5, -1.0, 0.8]])


def pole(place: int, *, relative_std: float = 0.0, off: float = 0.0) -> Mode:
    """A mode as a subspace method may have it. off: of its frequency, relative."""
    f, std = FREQUENCIES[place] * (1 + off), relative_std * FREQUENCIES[place]
    factor = np.zeros((5, 2))
    factor[0, 0], factor[1, 1] = std, 0.1 * DAMPING[place]
    return Mode("", f, std, DAMPING[place], 0.1 * DAMPING[place], SHAPES[place], factor, 2)


def window(seed: int) -> WindowSpectrum:
    """Ten minutes in a third as much noise."""
    generator = np.random.default_rng(seed)
    samples = ambient(FREQUENCIES, DAMPING, SHAPES, RATE, np.ones(3), 0.3, generator)
    return WindowSpectrum(samples, RATE)


def bound(place: int) -> FloatArray:
    """Std of a frequency that no estimate beats, of a mode alone [Hz]."""
    f = FREQUENCIES[place]
    return np.asarray(f * np.sqrt(DAMPING[place] / (2 * np.pi * f * 600)))


def test_a_wide_mode_beside_a_sharp_one_is_known_to_about_the_attainable_bound() -> None:
    errors, stds = [], []
    for seed in range(12):
        vague = pole(0, relative_std=0.02, off=0.02)
        found = with_neighbours(vague, [pole(1), pole(2)], window(seed), OmaSettings())
        assert found is not None
        errors.append((found.frequency - FREQUENCIES[0]) / found.frequency_std)
        stds.append(found.frequency_std / bound(0))
    assert np.median(stds) < 1.6
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.4)


def test_the_fit_of_expected_lines_is_their_model() -> None:
    """Lines that are what a model expects are fitted by this model, wherever the poles start."""
    around = around_mode(pole(0), [pole(1), pole(2)], window(1))
    assert around is not None
    true = around.fitted().modes
    exact = replace(around.band, matrices=expected_matrices(true, around.band.numbers))
    started = replace(around, modes=(pole(0, off=0.03), pole(1, off=0.002)), band=exact)
    fit = started.fitted()
    assert fit.converged
    np.testing.assert_allclose(fit.modes.positions, true.positions[:2], atol=0.3)
    np.testing.assert_allclose(fit.modes.half_widths, true.half_widths[:2], rtol=0.02)
    assert left_near_first(fit, exact) < 1.0


def test_a_fit_is_given_up_where_its_modes_need_a_slope_that_no_background_has() -> None:
    around = around_mode(pole(0), [pole(1), pole(2)], window(1))
    assert around is not None
    numbers = around.band.numbers
    slope = (numbers / numbers.mean()) ** 30
    steep = replace(around.band, matrices=around.band.matrices * slope[:, None, None])
    assert replace(around, band=steep).fitted().off_colour
    assert not replace(around, band=steep).fitted(np.inf).off_colour
    assert not around.fitted().off_colour


def test_bins_are_fine_at_the_sharp_mode_and_coarse_beside_it() -> None:
    around = around_mode(pole(0), [pole(1), pole(2)], window(2))
    assert around is not None
    band = around.band
    sharp = np.argmin(np.abs(band.numbers - FREQUENCIES[1] * 600))
    assert band.n_together[sharp] == 1
    assert band.n_together.max() > 10
    assert band.n_lines == pytest.approx(band.numbers[-1] - band.numbers[0], abs=40)


def test_the_last_bin_ends_where_modes_are_sought_no_longer() -> None:
    """A wide mode near half the rate, whose bins are wide, too."""
    high = replace(pole(0), frequency=4.0, damping_ratio=0.1)
    around = around_mode(high, [], window(2))
    assert around is not None
    numbers, together = around.band.numbers, around.band.n_together
    assert numbers[-1] + together[-1] / 2 <= HIGHEST_RELATIVE * RATE * 600 + 1
    assert numbers[-1] > 0.97 * HIGHEST_RELATIVE * RATE * 600


def test_a_neighbour_that_is_not_known_leaves_the_pole_as_it_is() -> None:
    """Its power stays unexplained."""
    around = around_mode(pole(0), [], window(3))
    assert around is not None
    fit = around.fitted()
    assert first_mode(fit, around.band).frequency_std > 0
    assert left_near_first(fit, around.band) > 20


def test_a_refused_mode_that_its_neighbours_leave_unexplained_is_reported() -> None:
    reason = RefusedMode(1.0, 0.05, "unstable", "")
    vague = pole(0, relative_std=0.02, off=0.01)
    known = [pole(1), pole(2)]
    result = sharpened(known, [reason], [(vague, reason)], window(4), OmaSettings())
    assert len(result.modes) == 3
    assert not result.refused
    elsewhere = replace(vague, frequency=1.8)
    result = sharpened([pole(0), *known], [reason], [(elsewhere, reason)], window(4), OmaSettings())
    assert len(result.modes) == 3
    assert result.refused == (reason,)


def test_a_mode_that_neighbours_leave_no_lines_below_is_not_fitted() -> None:
    """As many as are fitted together lie above it; one more, just below, ends its band there."""
    spectrum, mode = window(2), pole(0)
    width = mode.damping_ratio * mode.frequency
    above = [
        replace(mode, frequency=mode.frequency + (0.2 + 0.1 * k) * width)
        for k in range(neighbours.MOST_TOGETHER - 1)
    ]
    below = replace(mode, frequency=mode.frequency - 2 * width)
    assert around_mode(mode, above, spectrum) is not None
    assert around_mode(mode, [*above, below], spectrum) is None


def test_a_mode_that_another_one_hides_is_reported_and_both_are_right() -> None:
    """No pole shows the sharp one, on the flank of a wide one whose own lines do not show it."""
    vague = pole(0, relative_std=0.02, off=0.01)
    result = sharpened([vague, pole(2)], [], [], window(5), OmaSettings())
    assert len(result.modes) == 3
    for mode, true in zip(result.modes[:2], FREQUENCIES[:2], strict=True):
        assert mode.frequency == pytest.approx(true, abs=3 * mode.frequency_std)
        assert mode.frequency_std < 0.01


def test_a_pole_between_two_modes_of_nearly_one_shape_becomes_both() -> None:
    """6 % apart, as short lags merge them; no second direction stands out."""
    frequencies, shapes = np.array([1.0, 1.06, 2.6]), SHAPES.copy()
    shapes[1] = shapes[0] + np.array([0.0, 0.03, 0.03])
    damping = np.array([0.004, 0.004, 0.01])
    generator = np.random.default_rng(6)
    samples = ambient(frequencies, damping, shapes, RATE, np.ones(3), 0.5, generator)
    pole_between = replace(pole(0, relative_std=0.004, off=0.03), damping_ratio=0.03)
    spectrum = WindowSpectrum(samples, RATE)
    found = sharpened([pole_between, pole(2)], [], [], spectrum, OmaSettings()).modes
    assert len(found) == 3
    for mode, true in zip(found[:2], frequencies[:2], strict=True):
        assert mode.frequency == pytest.approx(true, abs=3 * mode.frequency_std)
        assert mode.frequency_std < 0.005
