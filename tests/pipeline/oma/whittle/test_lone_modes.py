"""A mode that stands alone in much noise, by the lines of its own resonance."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode, RefusedMode
from pipeline.oma.identification import identify
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.lone_modes import (
    ALONE_LINES,
    ALONE_WIDTHS,
    DenseBands,
    _all_known,
    _worth_a_fit,
    borne_out,
    by_its_lines,
    sharpened,
)
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import ambient

RATE = 10.0  # [Hz]
TRUE_F, TRUE_ZETA = 1.0, 0.01
SHAPE = np.array([1.0, 0.6, -0.4])


def pole(frequency: float, *, std: float, shape: FloatArray = SHAPE) -> Mode:
    factor = np.zeros((2 + len(shape), 2))
    factor[0, 0], factor[1, 1] = std, 0.005
    return Mode("", frequency, std, TRUE_ZETA, 0.005, shape, factor, 2)


def lines(frequencies: list[float], shapes: list[FloatArray], seed: int) -> WindowSpectrum:
    """Ten minutes of modes in as much noise."""
    samples = ambient(
        np.array(frequencies),
        np.full(len(frequencies), TRUE_ZETA),
        np.array(shapes),
        RATE,
        np.ones(len(frequencies)),
        1.0,
        np.random.default_rng(seed),
    )
    return WindowSpectrum(samples, RATE)


def test_a_vague_mode_alone_is_known_to_about_the_attainable_bound() -> None:
    bound = TRUE_F * np.sqrt(TRUE_ZETA / (2 * np.pi * TRUE_F * 600))
    errors, stds = [], []
    for seed in range(16):
        found = by_its_lines(
            pole(TRUE_F + 0.005, std=6 * bound),
            [],
            lines([TRUE_F], [SHAPE], seed),
            OmaSettings(),
        )
        assert found is not None
        errors.append((found.frequency - TRUE_F) / found.frequency_std)
        stds.append(found.frequency_std / bound)
    assert np.median(stds) < 1.8
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.4)


def test_a_band_of_two_modes_leaves_the_pole_as_it_is() -> None:
    spectrum = lines([TRUE_F, 1.04], [SHAPE, np.array([-0.3, 1.0, 0.7])], seed=1)
    assert by_its_lines(pole(TRUE_F, std=0.01), [], spectrum, OmaSettings()) is None


def test_a_refused_mode_that_its_lines_show_is_reported_and_noise_is_not() -> None:
    spectrum = lines([TRUE_F], [SHAPE], seed=2)
    for place, n_found in ((TRUE_F, 1), (3.0, 0)):
        vague = pole(place, std=0.02)
        reason = RefusedMode(place, TRUE_ZETA, "vague", "")
        result = sharpened([], [reason], [(vague, reason)], spectrum, OmaSettings())
        assert len(result.modes) == n_found
        assert len(result.refused) == 1 - n_found


def test_a_flank_of_a_mode_is_none_of_its_own() -> None:
    spectrum = lines([TRUE_F], [SHAPE], seed=3)
    known = pole(TRUE_F, std=0.001)
    flank = replace(pole(1.035, std=0.03), damping_ratio=0.005)
    reason = RefusedMode(flank.frequency, TRUE_ZETA, "vague", "")
    result = sharpened([known], [reason], [(flank, reason)], spectrum, OmaSettings())
    assert [mode.frequency for mode in result.modes] == [known.frequency]
    assert result.refused == (reason,)


def test_a_vague_pole_of_noise_is_refused_and_one_of_a_mode_stays() -> None:
    """Both are stable to the poles, and their f and ζ known to half the half bandwidth."""
    for seed in range(6):
        window = lines([TRUE_F], [SHAPE], seed)
        true, of_noise = pole(TRUE_F, std=0.005), pole(0.7, std=0.004, shape=SHAPE[::-1])
        found = borne_out([of_noise, true], [], window)
        assert found.modes == (true,)
        (reason,) = found.refused
        assert reason.code == "explained"
        assert reason.frequency == of_noise.frequency


@pytest.mark.parametrize(
    ("widths", "other_width", "known"), [(2.0, 1, True), (3.0, 1, False), (3.0, 2, True)]
)
def test_a_direction_at_a_resonance_is_another_modes_within_two_and_a_half_of_its_widths(
    widths: float, other_width: float, known: bool
) -> None:
    """Two directions stand out; the second one's mode is near by the wider of the two."""
    vague = pole(TRUE_F, std=0.006)
    beside = TRUE_F * (1 + widths * TRUE_ZETA)
    other = replace(pole(beside, std=0.006), damping_ratio=other_width * TRUE_ZETA / beside)
    for seed in range(4):
        spectrum = lines([TRUE_F, TRUE_F], [SHAPE, np.array([0.5, -1.0, 0.2])], seed)
        assert not _all_known(vague, [], spectrum)
        assert _all_known(vague, [other], spectrum) is known
    assert _all_known(vague, [], lines([TRUE_F], [SHAPE], 1))


def test_lines_are_asked_of_no_mode_that_is_well_known() -> None:
    sharp = replace(pole(0.7, std=0.002), damping_ratio_std=0.003)
    assert borne_out([sharp], [], lines([TRUE_F], [SHAPE], 1)).modes == (sharp,)


def frame_with_dampers(seed: int) -> tuple[FloatArray, FloatArray]:
    """Ten minutes of six storeys, two of them with a damper of their own, at 80 Hz; and damping.

    Returns samples, (n, 6), and ζ of the modes, lowest frequency first.
    """
    generator, n, rate = np.random.default_rng(seed), 48000, 80.0
    springs = 1500 * (2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1))
    springs[-1, -1] = 1500
    square, shapes = np.linalg.eigh(springs)
    omega = np.sqrt(square)
    dampers = (shapes * 0.008 * omega) @ shapes.T + np.diag([6.0, 0, 0, 4.5, 0, 0])
    system = np.block([[np.zeros((6, 6)), np.eye(6)], [-springs, -dampers]])
    poles = np.linalg.eigvals(system)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    w = 2 * np.pi * np.fft.rfftfreq(n, 1 / rate)[:, None, None]
    force = generator.standard_normal((2, len(w), 6, 1))
    moved = -(w**2) * np.linalg.solve(
        springs + 1j * w * dampers - w**2 * np.eye(6), force[0] + 1j * force[1]
    )
    samples = np.fft.irfft(moved[..., 0], n, axis=0)
    noise = 0.005 * samples.std(axis=0) * generator.standard_normal(samples.shape)
    return samples + noise, -poles.real / np.abs(poles)


@pytest.mark.nightly
def test_lines_do_not_widen_modes_whose_channels_have_phases_of_their_own() -> None:
    errors = []
    for seed in range(615370, 615373):
        samples, damping = frame_with_dampers(seed)
        modes = identify(samples, 80.0).modes
        assert len(modes) == len(damping)
        errors += [
            (mode.damping_ratio - true) / mode.damping_ratio_std
            for mode, true in zip(modes, damping, strict=True)
        ]
    assert max(errors) < 3.0


@pytest.mark.parametrize("side", [-1, 1])
def test_a_vague_mode_is_fitted_alone_only_where_no_other_one_is_near(side: int) -> None:
    spectrum, vague = lines([TRUE_F], [SHAPE], seed=2), pole(TRUE_F, std=0.02)
    clear = ALONE_WIDTHS * TRUE_ZETA * TRUE_F + ALONE_LINES / spectrum.duration
    near, far = (pole(TRUE_F + side * share * clear, std=0.001) for share in (0.9, 5.0))
    assert _worth_a_fit(vague, [], spectrum)
    assert _worth_a_fit(vague, [far], spectrum)
    assert not _worth_a_fit(vague, [far, near], spectrum)
    assert not _worth_a_fit(pole(TRUE_F, std=1e-4), [], spectrum)


def test_bands_that_no_fit_describes_leave_a_distant_mode_to_its_lines() -> None:
    """As a bending pair in a sea and blades' modes under one peak do to the rest of a window."""
    across = np.array([-0.3, 1.0, 0.7])
    spectrum = lines([TRUE_F, 1.04, 3.0], [SHAPE, SHAPE, across], seed=6)
    wrong = np.array([0.2, -0.5, 1.0])
    merged = [pole(f, std=0.06, shape=wrong) for f in (TRUE_F, 1.04)]
    distant = pole(3.0, std=0.03, shape=across)
    result = sharpened([*merged, distant], [], [], spectrum, OmaSettings())
    assert result.too_dense.holds(TRUE_F)
    assert not result.too_dense.holds(3.0)
    assert result.modes[-1].frequency_std < 0.3 * distant.frequency_std


def test_two_dense_bands_leave_the_rest_to_its_lines_and_a_third_says_that_all_is_dense() -> None:
    one = DenseBands().with_band((0.1, 0.2))
    two = one.with_band((1.0, 1.3))
    assert [one.holds(f) for f in (0.15, 1.1, 5.0)] == [False, False, False]
    assert [two.holds(f) for f in (0.15, 1.1, 5.0)] == [True, True, False]
    assert two.with_band((2.0, 2.2)).holds(5.0)
