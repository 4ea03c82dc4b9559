"""Spectra against their formulas, series against their spectra, totals against what is stated."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.signal import welch

from sensors.loads import (
    BroadbandLoad,
    FilteredNoise,
    LoadError,
    RandomLoad,
    RandomStream,
    WaveBandLoad,
    blade_pattern,
    generator,
    jonswap,
    random_loads,
    tower_pattern,
    wave_kernel,
    wave_number,
    wave_pattern,
    wave_profile,
    white_kernel,
)
from sensors.loads.filtered import spectral_kernel
from sensors.loads.synthesis import OVERLAP, SegmentedNoise, harmonics
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.structural_model import PLANE_COLUMNS, StructuralModel

RATE = 120.0  # [Hz]


@pytest.fixture(scope="module")
def tower() -> StructuralModel:
    return assemble(load_turbine("iea15mw_monopile"), tube_refinement=2)


def wave_load(n_series: int = 1) -> RandomLoad:
    kernel = wave_kernel(WaveBandLoad(), RATE)
    return RandomLoad(np.eye(n_series), kernel, RATE, RandomStream.WAVES)


def test_jonswap_without_enhancement_is_pierson_moskowitz() -> None:
    f, peak = np.linspace(0.05, 0.5, 40), 0.125
    expected = f**-5.0 * np.exp(-1.25 * (f / peak) ** -4.0)
    shape = jonswap(f, peak_frequency=peak, peak_enhancement=1.0) / expected
    np.testing.assert_allclose(shape, shape[0], rtol=1e-12)


@given(gamma=st.floats(1.0, 7.0), period=st.floats(3.0, 15.0))
def test_the_peak_of_jonswap_is_enhanced_by_gamma(gamma: float, period: float) -> None:
    peak = np.array([1.0 / period])
    ratio = jonswap(peak, peak_frequency=1 / period, peak_enhancement=gamma) / jonswap(
        peak, peak_frequency=1 / period, peak_enhancement=1.0
    )
    assert ratio.item() == pytest.approx(gamma)


def test_jonswap_has_nothing_at_zero_frequency() -> None:
    assert jonswap(np.zeros(1), peak_frequency=0.125, peak_enhancement=3.3).item() == 0.0


@given(frequency=st.floats(0.02, 1.0), depth=st.floats(5.0, 200.0))
def test_wave_number_satisfies_the_dispersion_relation(frequency: float, depth: float) -> None:
    k = wave_number(frequency, depth)
    assert 9.81 * k * np.tanh(k * depth) == pytest.approx((2 * np.pi * frequency) ** 2, rel=1e-9)


def test_wave_number_has_its_deep_and_shallow_water_limits() -> None:
    assert wave_number(0.5, 500.0) == pytest.approx((2 * np.pi * 0.5) ** 2 / 9.81, rel=1e-9)
    assert wave_number(0.005, 5.0) == pytest.approx(2 * np.pi * 0.005 / np.sqrt(9.81 * 5), rel=1e-3)


def test_a_waves_force_attacks_where_the_closed_form_says() -> None:
    nodes = np.linspace(-30.0, 15.0, 21)
    shares = wave_profile(nodes, mudline=-30.0, level=0.0, period=8.0)
    k = wave_number(1 / 8.0, 30.0)
    force = quad(lambda z: np.cosh(k * (z + 30)), -30, 0)[0]
    moment = quad(lambda z: z * np.cosh(k * (z + 30)), -30, 0)[0]
    assert shares.sum() == pytest.approx(1.0)
    assert shares @ nodes == pytest.approx(moment / force, abs=1e-3)
    assert not shares[
        nodes > 2.25
    ].any()  # dry nodes, but for the one that the surface's tube ends at


def test_waves_need_water_above_the_mudline() -> None:
    with pytest.raises(LoadError, match=r"-31 m.*-30 m"):
        wave_profile(np.array([-30.0, 0.0]), mudline=-30.0, level=-31.0, period=8.0)


def test_a_wave_series_has_the_spectrum_of_its_formula() -> None:
    load = wave_load()
    f = np.linspace(0.0, 2.0, 4001)
    formula = jonswap(f, peak_frequency=0.125, peak_enhancement=3.3)
    formula[f > 0.6] = 0.0
    formula /= np.trapezoid(formula, f)
    spectrum = load.spectrum(f)
    assert np.trapezoid(spectrum, f) == pytest.approx(1.0, rel=1e-3)
    assert f[np.argmax(spectrum)] == pytest.approx(0.125, abs=0.001)
    body = (f > 0.09) & (f < 0.59)
    np.testing.assert_allclose(spectrum[body], formula[body], rtol=0.04)  # the kernel's 300 s
    assert spectrum[f > 0.61].max() < 1e-6 * spectrum.max()


def test_a_wave_series_variance_and_peak_are_recovered_from_the_series() -> None:
    load = wave_load(n_series=8)
    duration = 3600.0
    series = next(load.series(seed=3, chunk=round(duration * RATE)))
    f = np.linspace(0.0, 1.0, 4001)
    scatter = np.sqrt(np.trapezoid(load.spectrum(f) ** 2, f) / duration / 8)  # of the mean variance
    assert np.mean(series**2) == pytest.approx(1.0, abs=4 * scatter)
    g, density = welch(series[::40], fs=RATE / 40, nperseg=600, axis=0)
    assert g[np.argmax(density.mean(axis=1))] == pytest.approx(0.125, abs=0.006)


def test_white_noise_has_variance_one_in_its_band() -> None:
    kernel = white_kernel(highest_frequency=60.0, sampling_rate=150.0)
    load = RandomLoad(np.eye(1), kernel, 150.0, RandomStream.TOWER)
    assert load.spectrum(np.array([0.0, 30.0])) * 60.0 == pytest.approx([1.0, 1.0])
    series = next(load.series(seed=5, chunk=200_000))
    assert np.var(series) == pytest.approx(75.0 / 60.0, rel=0.02)  # its band goes on to 75 Hz


@settings(deadline=None)
@given(cuts=st.lists(st.integers(0, 500), max_size=5))
def test_a_series_does_not_depend_on_the_chunks_it_is_drawn_in(cuts: list[int]) -> None:
    kernel = np.random.default_rng(1).standard_normal(50)
    whole = FilteredNoise(kernel, 3, np.random.default_rng(9)).advance(500)
    noise = FilteredNoise(kernel, 3, np.random.default_rng(9))
    edges = [0, *sorted(cuts), 500]
    segments = [noise.advance(end - start) for start, end in pairwise(edges)]
    np.testing.assert_allclose(np.concatenate(segments), whole, atol=1e-12)


def test_filtered_noise_is_the_convolution_of_what_was_drawn() -> None:
    kernel = np.array([0.5, -1.0, 2.0])
    series = FilteredNoise(kernel, 2, np.random.default_rng(9)).advance(40)
    rng = np.random.default_rng(9)
    white = np.concatenate([rng.standard_normal((2, 2)), rng.standard_normal((40, 2))])
    expected = [np.convolve(white[:, i], kernel, mode="valid") for i in range(2)]
    np.testing.assert_allclose(series, np.transpose(expected), atol=1e-12)


def test_the_sources_of_randomness_are_independent() -> None:
    draws = [generator(1, stream).standard_normal(20_000) for stream in RandomStream]
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 4 / np.sqrt(20_000)


def test_the_tower_nodes_together_have_the_stated_rms_in_each_direction(
    tower: StructuralModel,
) -> None:
    pattern = tower_pattern(tower, 50e3)
    n_nodes = len(tower.elevations)
    assert pattern.shape == (tower.n_dofs, 2 * n_nodes)
    for plane, columns in zip(
        PLANE_COLUMNS.values(), np.split(np.arange(2 * n_nodes), 2), strict=True
    ):
        forces = pattern[np.ix_(tower.tower_dofs[:, plane.start], columns)]
        np.testing.assert_allclose(forces @ forces.T, np.eye(n_nodes) * 50e3**2 / n_nodes)
        assert np.sqrt((forces.sum(axis=0) ** 2).sum()) == pytest.approx(50e3)  # their total


def test_each_blade_has_the_stated_rms_flapwise_and_edgewise(tower: StructuralModel) -> None:
    pattern = blade_pattern(tower, 15e3)
    for blade in tower.blade_dofs:
        for place in (0, 2):  # flapwise, edgewise displacement
            total = pattern[blade[:, place]].sum(axis=0)
            assert np.linalg.norm(total) == pytest.approx(15e3)
    assert np.count_nonzero(pattern) == pattern.shape[1] == 2 * tower.blade_dofs[..., 0].size


def test_the_wave_band_has_the_stated_rms_in_each_direction(tower: StructuralModel) -> None:
    pattern = wave_pattern(tower, WaveBandLoad())
    fore_aft, side_side = (tower.tower_dofs[:, plane.start] for plane in PLANE_COLUMNS.values())
    assert pattern[fore_aft].sum(axis=0) == pytest.approx([300e3, 0.0])
    assert pattern[side_side].sum(axis=0) == pytest.approx([0.0, 60e3])


def test_a_load_of_zero_is_left_out(tower: StructuralModel) -> None:
    loads = random_loads(
        tower,
        broadband=BroadbandLoad(blade_rms=0.0),
        waves=WaveBandLoad(fore_aft_rms=0.0, side_side_rms=0.0),
        sampling_rate=RATE,
    )
    assert [load.stream for load in loads] == [RandomStream.TOWER]


@pytest.mark.parametrize(
    ("settings_type", "wrong", "message"),
    [
        (BroadbandLoad, {"tower_rms": -1.0}, "tower_rms is -1 N"),
    ],
)
def test_a_load_that_cannot_be_is_refused_with_its_value(
    settings_type: type, wrong: dict[str, float], message: str
) -> None:
    with pytest.raises(LoadError, match=message):
        settings_type(**wrong)


def test_a_kernel_ends_in_nothing_and_is_symmetric_with_variance_one() -> None:
    kernel = spectral_kernel(1.0 / (1.0 + np.arange(33.0)), 40.0)
    assert len(kernel) == 64
    assert kernel[0] == pytest.approx(0.0, abs=1e-12)
    assert np.argmax(kernel) == 32
    np.testing.assert_allclose(kernel[1:], kernel[1:][::-1], atol=1e-12)
    assert np.linalg.norm(kernel) == pytest.approx(1.0)


def test_a_segment_has_at_least_one_harmonic_and_none_beyond_the_highest() -> None:
    assert harmonics(0.0).tolist() == [1 / (2 * OVERLAP)]
    assert len(harmonics(0.5)) == 600
    assert harmonics(0.5)[-1] == pytest.approx(0.5)


def test_a_series_holds_harmonics_up_to_half_its_rate() -> None:
    settings = {"n_sources": 1, "start": 0.0, "rng": np.random.default_rng(1)}
    rate = 0.1
    most = round(OVERLAP * rate)
    SegmentedNoise(lambda _, w: w, n_harmonics=most, sampling_rate=rate, **settings)
    with pytest.raises(LoadError, match=r"its series can hold 0\.05 Hz"):
        SegmentedNoise(lambda _, w: w, n_harmonics=most + 1, sampling_rate=rate, **settings)
