"""Each way in which a record may be unfit has its name, and is mended, warned of or rejected."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.data_quality.input_checks import (
    Finding,
    check_drift,
    check_samples,
    is_harmonic,
    mended,
)
from pipeline.oma.data_quality.timestamps import check_timestamps
from pipeline.oma.identification import check_window, hardly_damped, identify
from pipeline.oma.preprocessing import lines_of_channels
from tests.pipeline.oma.conftest import KnownStructure

RATE = 20.0  # [Hz]
NAMES = ["z41", "z145"]


@pytest.fixture
def record(two_mass_system: KnownStructure) -> np.ndarray:
    return two_mass_system.ambient_response(sampling_rate=RATE, duration=300.0, seed=9)


def only(findings: tuple[Finding, ...]) -> Finding:
    assert len(findings) == 1, findings
    return findings[0]


def test_a_healthy_record_has_no_finding(record: np.ndarray) -> None:
    assert check_samples(record, RATE, NAMES) == ()
    assert check_timestamps(np.arange(len(record)) / RATE, RATE) == ()


def test_a_doubled_channel_is_named_with_its_twin(record: np.ndarray) -> None:
    record[:, 1] = -2 * record[:, 0]
    finding = only(check_samples(record, RATE, NAMES))
    assert (finding.code, finding.action) == ("duplicate-channel", "warn")
    assert finding.text.startswith("z41 and z145")


def test_a_converter_at_its_limit_is_clipping(record: np.ndarray) -> None:
    limit = 0.7 * np.abs(record).max()
    finding = check_samples(np.clip(record, -limit, limit), RATE, NAMES)[0]
    assert (finding.code, finding.action) == ("clipped", "warn")


def test_a_window_that_is_cut_off_by_far_is_not_identified(record: np.ndarray) -> None:
    """1.5 rms: 13 % of a normal signal's samples."""
    record[:, 1] = np.clip(record[:, 1], *(np.array([-1.5, 1.5]) * record[:, 1].std()))
    finding = only(check_samples(record, RATE, NAMES))
    assert (finding.code, finding.action) == ("clipped", "reject")
    assert "% of its samples, 5 % is the most" in finding.text
    rejection = identify(record, RATE).rejection
    assert rejection is not None
    assert rejection.code == "clipped"


def test_a_limit_reached_for_a_part_of_the_window_is_clipping(record: np.ndarray) -> None:
    limit = 0.5 * np.abs(record).max()
    record[2000:3000] = np.clip(record[2000:3000], -limit, limit)
    finding = check_samples(record, RATE, NAMES)[0]
    assert (finding.code, finding.action) == ("clipped", "warn")
    assert "crests cut off at one height" in finding.text


def test_a_record_of_few_digits_is_not_clipping(record: np.ndarray) -> None:
    coarse = np.round(record, 0)
    assert "clipped" not in {each.code for each in check_samples(coarse, RATE, NAMES)}


def test_a_bit_error_is_mended_and_does_not_move_the_modes(record: np.ndarray) -> None:
    clean = identify(record, RATE)
    record[3000, 1] += 400.0
    finding = only(check_samples(record, RATE, NAMES))
    assert (finding.code, finding.action) == ("spikes", "mend")
    assert "z145 has 1 spikes of one sample, the first at 150.000 s" in finding.text
    found = identify(record, RATE)
    assert [m.frequency for m in found.modes] == pytest.approx(
        [m.frequency for m in clean.modes], rel=1e-4
    )


def test_a_spike_becomes_the_mean_of_its_neighbours(record: np.ndarray) -> None:
    expected = record.copy()
    expected[3000, 1] = (record[2999, 1] + record[3001, 1]) / 2
    record[3000, 1] += 400.0
    np.testing.assert_array_equal(mended(record, check_samples(record, RATE, NAMES)), expected)


def test_a_drifting_sensor_is_mended(record: np.ndarray) -> None:
    record[:, 0] += np.linspace(0, 30, len(record))
    finding = only(check_samples(record, RATE, NAMES))
    assert (finding.code, finding.action) == ("drift", "mend")


def test_a_rotor_stop_is_not_stationary(record: np.ndarray) -> None:
    time = np.arange(len(record)) / RATE
    record *= (1 + 9 * np.exp(-(((time - 100) / 8) ** 2)))[:, None]
    finding = only(check_samples(record, RATE, NAMES))
    assert (finding.code, finding.action) == ("non-stationary", "warn")


def test_a_machines_harmonic_is_no_mode(record: np.ndarray) -> None:
    time = np.arange(len(record)) / RATE
    shaken = record + 0.8 * np.sin(2 * np.pi * 2.3 * time)[:, None]
    result = identify(shaken, RATE)
    assert "harmonic" in [warning.code for warning in result.warnings]
    assert not [m for m in result.modes if abs(m.frequency - 2.3) < 0.02]
    for frequency in (1.236, 3.236):
        assert not is_harmonic(record, RATE, frequency)
        assert [m for m in result.modes if abs(m.frequency / frequency - 1) < 0.01]


def test_a_weak_harmonic_in_noise_is_one_line() -> None:
    """Half of the time its amplitude, a fifth of the std of the noise, does not look steady."""
    n, found = round(900 * RATE), 0
    for seed in range(615400, 615410):
        generator = np.random.default_rng(seed)
        tone = 0.2 * np.sin(2 * np.pi * 3.002 * np.arange(n) / RATE)
        samples = tone[:, None] * [1.0, -0.5] + generator.standard_normal((n, 2))
        found += is_harmonic(samples, RATE, 3.0, half_bandwidth=5 / 900)
    assert found >= 9


@pytest.mark.parametrize("damping", [0.0005, 0.001, 0.002])
def test_a_hardly_damped_mode_is_more_than_one_line(damping: float) -> None:
    n = round(1800 * RATE)
    ratio = np.fft.rfftfreq(n, 1 / RATE) / 5.0
    gain = ratio**2 / (1 - ratio**2 + 2j * damping * ratio)
    for seed in range(615410, 615440):
        generator = np.random.default_rng(seed)
        force = generator.standard_normal((2, len(gain)))
        motion = np.fft.irfft(gain * (force[0] + 1j * force[1]), n)
        samples = np.outer(motion, [1.0, -0.5]) + 1e-3 * generator.standard_normal((n, 2))
        assert not is_harmonic(samples, RATE, 5.0, half_bandwidth=5.0 * damping)


@pytest.mark.parametrize(
    ("damping", "std", "harmonic"),
    [(0.0001, 0.0008, True), (0.0004, 0.0025, True), (0.0018, 0.0023, False), (0.005, 0.0, False)],
)
def test_only_what_is_surely_hardly_damped_may_be_a_harmonic(
    damping: float, std: float, harmonic: bool
) -> None:
    """The first two were sines in 120 s of noise, the third a mode of 1 % at 0.16 Hz in 120 s."""
    found = Mode("", 0.16, 1e-4, damping, std, np.ones(2), np.zeros((4, 1)), 1)
    assert hardly_damped(found) == harmonic


def test_what_is_damped_less_than_any_structure_stays_with_a_warning(
    two_mass_system: KnownStructure,
) -> None:
    """A line that is not steady: a machine whose speed drifts looks like this."""
    damping = np.array([0.01, 0.0003])
    narrow = replace(two_mass_system, frequencies=np.array([1.2, 4.0]), damping_ratios=damping)
    samples = narrow.ambient_response(sampling_rate=10.0, duration=600.0, seed=0)
    result = identify(samples, 10.0)
    assert [each.frequency for each in result.modes] == pytest.approx([1.2, 4.0], rel=0.01)
    (warning,) = result.warnings
    assert warning.code == "harmonic"
    assert warning.text.startswith("what shakes at 4 Hz is damped by 0.03 %, less than any")


def test_a_gap_in_the_stamps_is_rejected_with_its_length_and_place() -> None:
    times = np.arange(2000) / RATE
    times[1000:] += 0.4
    finding = only(check_timestamps(times, RATE))
    assert (finding.code, finding.action) == ("gap", "reject")
    assert finding.text == "gap of 0.45 s at 49.950 s (1 in all)"


def test_stamps_that_go_back_are_rejected() -> None:
    times = np.arange(2000) / RATE
    times[700] = times[600]
    assert only(check_timestamps(times, RATE)).action == "reject"


def test_samples_are_counted_from_one_as_elsewhere() -> None:
    times = np.arange(2400) / 40.0
    times[1000:] -= 1.0
    text = "do not increase: sample 1001 is at 24 s, sample 1000 before it at 24.975 s; each stamp"
    assert text in only(check_timestamps(times, 40.0)).text
    times[1000] = np.nan
    assert "sample 1001 is at nan s" in only(check_timestamps(times, 40.0)).text


def test_an_uneven_clock_is_resampled_and_the_modes_stay(
    two_mass_system: KnownStructure,
) -> None:
    """Sampled at 80 Hz, of which about every fourth sample is kept: steps of 3 to 5."""
    fine = two_mass_system.ambient_response(sampling_rate=80.0, duration=300.0, seed=9, noise=0.0)
    steps = np.random.default_rng(2).integers(3, 6, size=len(fine) // 4)
    kept = np.cumsum(steps)
    kept = kept[kept < len(fine)]
    result = identify(fine[kept], RATE, times=kept / 80.0)
    assert [warning.code for warning in result.warnings] == ["uneven-clock"]
    for frequency in two_mass_system.frequencies:
        nearest = min(abs(m.frequency - frequency) for m in result.modes)
        assert nearest < 0.01 * frequency


def test_stamps_that_contradict_the_stated_rate_are_followed(record: np.ndarray) -> None:
    result = identify(record, 25.0, times=np.arange(len(record)) / RATE)
    assert "sampling-rate" in [warning.code for warning in result.warnings]
    assert min(abs(m.frequency - 1.236) for m in result.modes) < 0.0124


def test_checks_hold_few_copies_of_the_samples() -> None:
    samples = np.random.default_rng(3).normal(size=(20_000, 24)).astype(np.float32)
    tracemalloc.start()
    check_window(samples, 40.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 32 * samples.size  # [bytes]; 60 and more where all channels are worked on at once


def test_lines_of_channels_are_those_of_all_at_once() -> None:
    samples = np.random.default_rng(4).normal(size=(301, 3))
    scales, taper = np.array([1.0, 2.0, 0.5]), np.hanning(301)
    at_once = np.fft.rfft(taper[:, None] * samples / scales, axis=0)
    np.testing.assert_allclose(lines_of_channels(samples, scales, taper), at_once, atol=1e-12)
    untapered = np.fft.rfft(samples / scales, axis=0)
    np.testing.assert_allclose(lines_of_channels(samples, scales), untapered, atol=1e-12)


@pytest.mark.parametrize("rise", [-100.0, 2.1, 1.9])
def test_a_drift_is_told_with_its_rise_and_with_the_motion_about_its_line(rise: float) -> None:
    """Of a motion of 1 rms the line counts from where it rises by twice that."""
    time = np.linspace(-1.0, 1.0, 2000)
    line = np.stack([np.ones(2000), time])
    noise = np.random.default_rng(6).standard_normal(2000)
    noise -= np.linalg.lstsq(line.T, noise, rcond=None)[0] @ line
    found = check_drift((rise / 2 * time + noise / noise.std())[:, None], ["z20"])
    text = f"z20 drifts by {abs(rise):.3g} over the window (rms 1); a line is taken off"
    assert [each.text for each in found] == ([text] if abs(rise) > 2 else [])
