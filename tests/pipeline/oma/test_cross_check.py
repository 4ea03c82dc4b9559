"""A second estimator beside the poles, and the peaks that stand in for poles that are missing."""

import numpy as np
import pytest

from pipeline.oma import close_modes
from pipeline.oma.cross_check import _of_taper, cross_checks, disagreements
from pipeline.oma.identification import identify
from pipeline.oma.settings import OmaSettings
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import ambient
from tests.tiers import and_at_night

RATE = 20.0
FREQUENCIES, DAMPING = np.array([1.1, 3.4]), np.array([0.012, 0.02])


def two_modes(seed: int) -> FloatArray:
    generator = np.random.default_rng(seed)
    shapes = np.array([[0.3, 0.7, 1.0], [-0.8, -0.4, 1.0]])
    return ambient(FREQUENCIES, DAMPING, shapes, RATE, np.ones(2), 0.05, generator)


@pytest.mark.parametrize("seeds", and_at_night(range(3), range(3, 8)))
def test_the_second_estimate_finds_what_the_structure_has(seeds: range) -> None:
    errors = []
    for seed in seeds:
        found = identify(two_modes(seed), RATE, cross_checked=True)
        assert not [each for each in found.warnings if each.code == "cross-check"]
        for mode, check in zip(found.modes, found.cross_checks, strict=True):
            place = int(np.argmin(np.abs(FREQUENCIES - mode.frequency)))
            assert check is not None
            errors.append(
                [
                    (check.frequency - FREQUENCIES[place]) / check.frequency_std,
                    (check.damping_ratio - DAMPING[place]) / check.damping_ratio_std,
                ]
            )
    assert len(errors) == 2 * len(seeds)
    assert np.sqrt(np.mean(np.square(errors))) < 1.2


def test_a_mode_that_is_moved_is_warned_of() -> None:
    samples = two_modes(1)
    samples = samples - samples.mean(axis=0)
    modes = identify(samples, RATE).modes
    checks = cross_checks(modes, samples, RATE)
    moved = [
        type(mode)(
            "",
            mode.frequency * 1.02,
            mode.frequency_std,
            mode.damping_ratio,
            mode.damping_ratio_std,
            mode.shape,
            mode.covariance_factor,
            0,
        )
        for mode in modes
    ]
    assert disagreements(modes, checks) == []
    assert len(disagreements(moved, checks)) == len(modes)


def test_the_tapers_autocorrelation_is_that_of_its_samples() -> None:
    n = 4000
    taper = np.hanning(n)
    lags = np.array([0, 400, 1200, 2000])
    products = [float(taper[: n - lag] @ taper[lag:]) for lag in lags.tolist()]
    assert _of_taper(lags / n) == pytest.approx(np.array(products) / products[0], abs=1e-3)


def test_peaks_stand_in_where_no_pole_is_stable(monkeypatch: pytest.MonkeyPatch) -> None:
    """In ten seconds: three of four have no pole that is stable."""
    empty, with_peaks = 0, 0
    for seed in range(4):
        samples = two_modes(seed)[:200]
        with_peaks += not identify(samples, RATE).modes
        with monkeypatch.context() as patch:
            patch.setattr(close_modes, "lone_peaks", lambda spectrum: [])
            empty += not identify(samples, RATE).modes
    assert with_peaks == 0 < empty


@pytest.mark.parametrize(("lowest", "highest"), [(None, 0.4), (None, 1.0), (4.0, None)])
@pytest.mark.parametrize("n_samples", [600, 2400, 4800])
@pytest.mark.parametrize("seeds", and_at_night([0], [1, 2]))
def test_modes_that_were_not_asked_for_are_not_found(
    lowest: float | None, highest: float | None, n_samples: int, seeds: list[int]
) -> None:
    """No mode is within the limits; those of 1.1 and 3.4 Hz, far beyond and near, have peaks."""
    settings = OmaSettings(lowest_frequency=lowest, highest_frequency=highest)
    for seed in seeds:
        assert identify(two_modes(seed)[:n_samples], RATE, settings).modes == ()


def test_noise_has_no_lone_peak() -> None:
    for seed in range(10):
        noise = np.random.default_rng(seed).standard_normal((2400, 3))
        spectrum = close_modes.WindowSpectrum(noise, RATE)
        assert close_modes.lone_peaks(spectrum) == []
