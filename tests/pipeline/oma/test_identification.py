"""A window of samples is turned into the modes of the structure that shook."""

import numpy as np
import pytest

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import Identification, identify
from pipeline.oma.settings import OmaSettings, OmaSettingsError
from sensors.arrays import FloatArray
from tests.pipeline.oma.conftest import KnownStructure, structure
from tests.tiers import and_at_night


def assert_modes_found(known: KnownStructure, result: Identification, *, tolerance: float) -> None:
    assert result.rejection is None
    for frequency, shape in zip(known.frequencies, known.shapes, strict=True):
        mode = min(result.modes, key=lambda m: abs(m.frequency - frequency))
        assert mode.frequency == pytest.approx(frequency, rel=tolerance)
        assert modal_assurance_criterion(mode.shape[None], shape[None])[0, 0] > 0.99


def test_two_masses_on_springs_have_their_closed_form_modes(
    two_mass_system: KnownStructure,
) -> None:
    y = two_mass_system.ambient_response(sampling_rate=20.0, duration=600.0, seed=7)
    result = identify(y, 20.0)
    assert_modes_found(two_mass_system, result, tolerance=0.01)
    for mode in result.modes:
        nearest = np.argmin(np.abs(two_mass_system.frequencies - mode.frequency))
        if abs(two_mass_system.frequencies[nearest] - mode.frequency) < 0.02 * mode.frequency:
            assert mode.damping_ratio == pytest.approx(0.01, abs=4 * mode.damping_ratio_std)


def test_a_slow_tower_and_a_fast_frame_need_no_other_settings(
    cantilever: KnownStructure, laboratory_frame: KnownStructure
) -> None:
    tower = cantilever.ambient_response(sampling_rate=40.0, duration=300.0, seed=7)
    assert_modes_found(cantilever, identify(tower, 40.0), tolerance=0.01)
    frame = laboratory_frame.ambient_response(sampling_rate=100.0, duration=120.0, seed=7)
    assert_modes_found(laboratory_frame, identify(frame, 100.0), tolerance=0.01)


def test_what_is_not_looked_at_of_many_channels_is_said() -> None:
    noise = np.random.default_rng(21).standard_normal((400, 21))
    told = [[each.code for each in identify(noise[:, :n], 20.0).warnings] for n in (20, 21)]
    assert told == [[], ["many-channels"]]


def test_largest_component_is_one_and_has_no_variance(cantilever: KnownStructure) -> None:
    y = cantilever.ambient_response(sampling_rate=40.0, duration=300.0, seed=3)
    for mode in identify(y, 40.0).modes:
        assert mode.shape[mode.unit_component] == 1.0
        assert mode.shape_std[mode.unit_component] == 0.0
        assert mode.frequency_std == pytest.approx(np.sqrt(mode.covariance[0, 0]))


def test_a_lost_second_is_filled_and_moves_no_mode(two_mass_system: KnownStructure) -> None:
    y = two_mass_system.ambient_response(sampling_rate=20.0, duration=300.0, seed=1)
    whole = identify(y, 20.0)
    y[400:420, 1] = np.nan
    result = identify(y, 20.0)
    assert [warning.code for warning in result.warnings] == ["missing"]
    assert "channel 2, 20.000 s after the start of the window" in result.warnings[0].text
    for mode, before in zip(result.modes, whole.modes, strict=True):
        assert mode.frequency == pytest.approx(before.frequency, abs=0.4 * before.frequency_std)


def test_a_window_that_lacks_much_is_rejected(two_mass_system: KnownStructure) -> None:
    y = two_mass_system.ambient_response(sampling_rate=20.0, duration=60.0, seed=1)
    y[400:500, 1] = np.nan
    result = identify(y, 20.0)
    assert result.modes == ()
    assert result.rejection is not None
    assert result.rejection.code == "nan"
    assert "8.33 % of a channel, 5 % is the most" in result.rejection.text


def test_a_dead_channel_is_rejected_by_its_name(two_mass_system: KnownStructure) -> None:
    y = two_mass_system.ambient_response(sampling_rate=20.0, duration=60.0, seed=1)
    y[:, 0] = 0.25
    rejection = identify(y, 20.0, channel_names=["z41-fa", "z80-fa"]).rejection
    assert rejection is not None
    assert (rejection.code, rejection.text) == (
        "constant",
        "z41-fa is constant over the window",
    )


def test_a_frequency_beyond_the_sampling_rate_is_refused(two_mass_system: KnownStructure) -> None:
    y = two_mass_system.ambient_response(sampling_rate=20.0, duration=60.0, seed=1)
    with pytest.raises(OmaSettingsError, match="highest_frequency is 15 Hz"):
        identify(y, 20.0, OmaSettings(highest_frequency=15.0))


def test_a_band_without_width_is_refused() -> None:
    with pytest.raises(OmaSettingsError, match=r"2 Hz, not above lowest_frequency \(2 Hz\)"):
        OmaSettings(lowest_frequency=2.0, highest_frequency=2.0)


def test_one_sample_is_too_short() -> None:
    rejection = identify(np.array([[1.0, 2.0]]), 40.0).rejection
    assert rejection is not None


def samples_of(kind: str) -> FloatArray:
    rng = np.random.default_rng(11)
    time, noise = np.arange(2400) / 40, rng.standard_normal((2400, 4))
    bits = np.nan_to_num(np.frombuffer(rng.bytes(40 * 4 * 4), "<f4").astype(float)).reshape(40, 4)
    if kind == "bits":  # a second of a link without a checksum
        return np.vstack([noise[:600], bits, noise[640:]])
    if kind == "step":
        return noise + 1e8 * (time > 30)[:, None]
    if kind == "curve":
        return noise + 1e6 * time[:, None] ** 3
    if kind == "tone":
        return np.sin(2 * time)[:, None] * np.ones(4)
    if kind == "two tones in two":
        return np.column_stack([np.sin(2 * time), np.sin(2 * time + 1)])
    return np.vstack([noise[:600], np.full((480, 4), 3.4e38), noise[1080:]])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "kind", ["bits", "step", "curve", "tone", "two tones in two", "largest float"]
)
def test_what_is_no_vibration_is_rejected_and_nothing_is_raised(kind: str) -> None:
    found = identify(samples_of(kind), 40.0)
    assert found.rejection is not None
    assert found.rejection.code == "no-vibration"
    assert "beyond any sensor's range" in found.rejection.text


@pytest.mark.parametrize("seeds", and_at_night([1], [2, 3]))
@pytest.mark.parametrize("n_channels", [1, 2, 4])
def test_a_neighbours_skirt_holds_no_mode(n_channels: int, seeds: list[int]) -> None:
    shapes = np.array([[1.0, 0.6, -0.3, 0.8], [-0.6, 1.0, 0.9, 0.4]])[:, :n_channels]
    known = structure([1.9, 5.0], 0.01, shapes)
    for seed in seeds:
        y = known.ambient_response(sampling_rate=50.0, duration=300.0, seed=seed)
        frequencies = [mode.frequency for mode in identify(y, 50.0).modes]
        np.testing.assert_allclose(frequencies, [1.9, 5.0], rtol=0.01)


@pytest.mark.parametrize("n_channels", [1, 2, 3, 8])
def test_white_noise_holds_no_mode(n_channels: int) -> None:
    y = np.random.default_rng(17).standard_normal((12_000, n_channels))
    assert identify(y, 40.0).modes == ()


def test_a_wandering_tone_in_two_directions_is_no_pair_of_modes(
    cantilever: KnownStructure,
) -> None:
    """No pole shows it: an idling rotor's blades pass the tower at 2 rpm, give or take 1 %."""
    rate, duration = 10.0, 1800.0
    sway = cantilever.ambient_response(sampling_rate=rate, duration=duration, seed=5)
    across = cantilever.ambient_response(sampling_rate=rate, duration=duration, seed=6)
    times = np.arange(len(sway)) / rate
    phase = 2 * np.pi * np.cumsum(0.1 * (1 + 0.01 * np.sin(2 * np.pi * times / 300))) / rate
    top = cantilever.shapes[0]
    y = np.column_stack(
        [sway + 0.3 * np.outer(np.cos(phase), top), across + 0.2 * np.outer(np.sin(phase), top)]
    )
    result = identify(y[:, [4, 9, 2, 7]], rate)
    assert min(mode.frequency for mode in result.modes) > 0.3
    assert "harmonic" in [warning.code for warning in result.warnings]
