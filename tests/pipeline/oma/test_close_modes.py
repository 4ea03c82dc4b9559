"""Modes that hide each other, ring-downs and lost seconds: the short form of `close_modes`."""

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma import close_modes
from pipeline.oma.data_quality.transients import loudest_octave
from pipeline.oma.identification import identify
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from tests.benchmarks.close_modes import (
    ambient,
    bending_pair,
    hidden_figures,
    left_over,
    lost_figures,
    pair,
    ring_down,
    triplet,
)
from tests.benchmarks.identification import parked_record
from tests.tiers import and_at_night


@pytest.mark.parametrize("seeds", and_at_night(range(60_001, 60_005), range(60_005, 60_009)))
def test_two_first_bending_modes_are_two_and_no_phantom_is_left(seeds: range) -> None:
    found = hidden_figures(bending_pair, seeds)
    assert found["phantoms"] + found["wrong_shapes"] + found["wrong_frequencies"] <= 1
    assert found["all_found"] >= 0.75
    assert found["within_2_std"] >= 0.8


@pytest.mark.parametrize("seeds", and_at_night(range(60_001, 60_005), range(60_005, 60_009)))
def test_overlapping_modes_with_shapes_apart_are_both_found(seeds: range) -> None:
    found = hidden_figures(lambda seed: pair(seed, 0.015), seeds)
    assert found["all_found"] >= 0.75


def test_the_benchmark_tells_phantoms_from_modes_of_a_wrong_shape_or_frequency() -> None:
    one, other = np.array([1.0, 0.2, -0.4]), np.array([-0.2, 1.0, 0.5])
    factor = np.full((5, 1), 0.002)
    mode = Mode("", 2.0, 0.002, 0.01, 0.002, one, factor, 0)
    assert left_over([mode], [(2.003, other)]) == (1, 0, 0)
    assert left_over([mode], [(2.02, one)]) == (0, 1, 0)
    assert left_over([mode], [(2.02, other)]) == (0, 0, 1)
    assert left_over([mode, mode], [(2.003, other)]) == (1, 0, 1)
    assert left_over([mode], []) == (0, 0, 1)


@pytest.mark.parametrize("seeds", and_at_night((60_001, 60_033), (60_002, 60_039)))
def test_triplets_are_not_lost_without_a_word(seeds: tuple[int, ...]) -> None:
    """Of 60033 and 60039 the poles agree upon nothing, which they call unstable."""
    for seed in seeds:
        record = triplet(seed)
        hidden = record.frequencies[:3]
        modes = identify(record.samples, record.sampling_rate).modes
        assert any(abs(m.frequency / hidden.mean() - 1) < 0.03 for m in modes)


@pytest.mark.parametrize(
    "window", and_at_night((293_204, 2.888, 2.9045), (293_213, 2.5808, 2.5983))
)
def test_lines_on_a_slope_do_not_take_the_place_of_a_pole(
    window: tuple[int, float, float],
) -> None:
    """The last window of an hour, where a fit of two modes, side-side and fore-aft, is of no
    structure's colour (−3.8 and −3.9): its fore-aft mode lay 5 std off, and in one of them it had
    replaced a pole that was right."""
    seed, side_side, fore_aft = window
    samples = parked_record(seed, 3600.0)[-24_000:]
    near = [
        mode
        for mode in identify(samples, 40.0).modes
        if side_side - 0.05 < mode.frequency < fore_aft + 0.05
    ]
    assert near
    for mode in near:
        along = np.linalg.norm(mode.shape[:4]) > np.linalg.norm(mode.shape[4:])
        truth = fore_aft if along else side_side
        assert abs(mode.frequency - truth) < 3 * mode.frequency_std


@pytest.mark.nightly
def test_what_bends_a_background_is_no_third_mode_of_a_pair() -> None:
    """The first bending modes of the first window were three, two of one force."""
    window = parked_record(284_008, 3600.0)[:24_000]
    first_bending = [mode for mode in identify(window, 40.0).modes if mode.frequency < 0.2]
    assert len(first_bending) == 2
    assert len({mode.pair_id for mode in first_bending}) == 1


def test_the_flank_of_a_stronger_neighbour_of_its_shape_does_not_pull_a_mode() -> None:
    """Four half bandwidths apart; the fit of a band that ended short of it began the pull."""
    frequencies, damping = np.array([1.48, 1.58]), np.array([0.01, 0.015])
    shapes = np.array([[1.0, 0.5, -0.3], [1.0, 0.7, -0.1]])
    errors = []
    for seed in range(6):
        samples = ambient(
            frequencies,
            damping,
            shapes,
            8.0,
            np.array([1.0, 3.0]),
            0.1,
            np.random.default_rng(seed),
        )
        pulled, neighbour = (
            Mode("", f, 0.003, zeta, 0.002, shape, np.full((5, 1), 0.002), columns)
            for f, zeta, shape, columns in zip(
                frequencies + np.array([0.025, 0.0]), damping, shapes, (0, 1), strict=True
            )
        )
        first = close_modes.beside_flanks(
            [pulled, neighbour], WindowSpectrum(samples, 8.0), OmaSettings()
        )[-1]
        errors.append((first.frequency - frequencies[0]) / first.frequency_std)
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def test_a_ring_down_is_not_stationary_and_ambient_motion_is() -> None:
    for seed in range(60_001, 60_006):
        quiet, loud = bending_pair(seed), ring_down(seed, 10.0)
        for record, expected in ((quiet, False), (loud, True)):
            steady = record.samples - record.samples.mean(axis=0)
            octave = loudest_octave(steady, record.sampling_rate)
            assert octave is not None
            assert (octave.excess > 1) == expected


def test_poles_stay_where_nothing_that_the_lines_suggest_is_sure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(close_modes, "_bears_out", lambda mode, poles: False)
    monkeypatch.setattr(close_modes, "_plausible_addition", lambda *arguments: False)
    monkeypatch.setattr(close_modes, "UNRESOLVED", np.inf)
    record = pair(60_001, 0.3)
    assert identify(record.samples, record.sampling_rate).modes


@pytest.mark.parametrize("seeds", and_at_night(range(60_001, 60_002), range(60_002, 60_004)))
def test_lost_blocks_cost_no_window(seeds: range) -> None:
    found = lost_figures(seeds, "blocks")
    assert found["windows_lost"] == 0
    assert found["shift_rms_std"] < 0.6
