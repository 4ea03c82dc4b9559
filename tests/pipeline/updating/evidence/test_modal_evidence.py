"""Windows combined, mode by mode, before any model is asked."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.updating.evidence import mode_evidence
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import PartnerInWater
from pipeline.updating.evidence.observations import EstimateRefused, mode_observations
from tests.pipeline.updating.small_tower import LAYOUT, drawn_estimate, drawn_mode

TRUTH = np.array([1.1, 0.9, 0.95])
LABELS = ("3", "4", "5")  # apart enough to be followed without doubt


def empty(joint_covariance=False):
    return ModalEvidence(channels=LAYOUT.channel_names, joint_covariance=joint_covariance)


def windows(n, *, seed, **options):
    generator = np.random.default_rng(seed)
    options = {"labels": LABELS, **options}
    return [drawn_estimate(TRUTH, generator, window=number, **options) for number in range(n)]


def combined(estimates, **options):
    evidence = empty(**options)
    for estimate in estimates:
        evidence = evidence.with_estimate(estimate)
    return evidence


def test_two_equal_windows_halve_the_variance_and_keep_the_mean():
    one, two = combined(windows(1, seed=1)), combined(windows(1, seed=1) * 2)
    assert two.modes[0].frequency == pytest.approx(one.modes[0].frequency, rel=1e-12)
    ratio = two.modes[0].covariance[0, 0] / one.modes[0].covariance[0, 0]
    assert ratio == pytest.approx(0.5, rel=1e-12)


def test_combined_frequencies_are_the_precision_weighted_means():
    first, second = (
        windows(1, seed=2, frequency_std=0.001),
        windows(1, seed=3, frequency_std=0.0005),
    )
    both = combined(first + second)
    for number, mode in enumerate(both.modes):
        a, b = first[0].modes[number], second[0].modes[number]
        wa, wb = a.frequency_std**-2, b.frequency_std**-2
        assert mode.frequency == pytest.approx((wa * a.frequency + wb * b.frequency) / (wa + wb))


def test_what_windows_resolve_is_what_the_shortest_of_them_does():
    long, other = windows(2, seed=3)
    short = replace(other, end_ns=(other.start_ns + other.end_ns) // 2)
    for order in ([long, short], [short, long]):
        assert combined(order).window_duration == pytest.approx(short.duration)


def test_the_share_of_windows_without_a_water_level_is_known():
    """It decides how far the level may be off: as a gauge reports it, or by the tide."""
    told, untold = windows(2, seed=3)
    evidence = combined([replace(told, water_level=0.4), untold, untold, untold])
    assert evidence.unknown_level_share == 0.75


def test_a_window_that_overlaps_by_nine_tenths_counts_a_tenth():
    whole = combined(windows(1, seed=4))
    tenth = combined(windows(1, seed=4, weight=0.1))
    assert np.allclose(tenth.modes[0].information, 0.1 * whole.modes[0].information)


def test_the_unit_component_carries_no_information():
    for mode in combined(windows(3, seed=5)).modes:
        assert mode.information[1 + mode.unit_component].any() == np.False_
        assert mode.shape[mode.unit_component] == 1.0


def test_the_unit_component_stays_where_the_first_window_put_it():
    """A shape whose two largest components are nearly equal is normalised to either of them."""
    shape = np.array([1.0, -0.98, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    generator = np.random.default_rng(6)
    estimate = windows(1, seed=6)[0]
    estimates = [
        replace(estimate, modes=(drawn_mode(2.0, shape, generator, 0.001, 0.03),))
        for _ in range(60)
    ]
    assert {each.modes[0].unit_component for each in estimates} == {0, 1}
    (mode,) = combined(estimates).modes
    expected = shape / shape[mode.unit_component]
    assert mode.shape == pytest.approx(expected, abs=4 * 0.03 * np.sqrt(2) / np.sqrt(60))


def test_the_state_does_not_grow_with_the_number_of_windows():
    few, many = combined(windows(2, seed=7)), combined(windows(20, seed=7))
    assert len(few.modes) == len(many.modes) == len(LABELS)
    assert many.n_windows == 20
    assert all(mode.n_windows == 20 for mode in many.modes)


def test_windows_combine_to_the_same_whatever_their_order():
    estimates = windows(5, seed=8)
    forwards, backwards = combined(estimates), combined(estimates[::-1])
    for one, other in zip(forwards.modes, backwards.modes, strict=True):
        known = one.known & other.known
        assert np.allclose(one.mean[0], other.mean[0], rtol=1e-9)
        assert known[0]


def test_channels_are_mapped_by_name_whatever_their_order_and_number():
    estimate = windows(1, seed=9)[0]
    kept = [5, 0, 2, 7, 3, 1]
    partial = reordered(estimate, kept)
    names = [LAYOUT.channel_names[index] for index in kept]
    assert list(partial.channels) == names
    for whole, part in zip(
        mode_observations(estimate, LAYOUT.channel_names),
        mode_observations(partial, LAYOUT.channel_names),
        strict=True,
    ):
        assert np.isnan(part.shape[[4, 6]]).all()
        assert np.array_equal(part.shape[kept], whole.shape[kept])


def reordered(estimate, kept) -> ModalEstimate:
    """The same estimate with some channels only, in another order."""
    modes = tuple(
        replace(
            mode,
            shape=mode.shape[kept],
            covariance_factor=mode.covariance_factor[[0, 1, *(2 + index for index in kept)]],
        )
        for mode in estimate.modes
        if mode.unit_component in kept
    )
    channels = tuple(estimate.channels[index] for index in kept)
    return replace(estimate, channels=channels, modes=modes)


def test_a_window_without_the_unit_channel_still_tells_the_frequency():
    first, second = windows(2, seed=10)
    unit = first.modes[0].unit_component
    kept = [index for index in range(len(first.channels)) if index != unit]
    modes = tuple(
        replace(
            mode,
            shape=mode.shape[kept] / np.abs(mode.shape[kept]).max(),
            covariance_factor=mode.covariance_factor[[0, 1, *(2 + index for index in kept)]]
            + 1e-12,
        )
        for mode in second.modes[:1]
    )
    channels = tuple(first.channels[index] for index in kept)
    before = combined([first])
    after = before.with_estimate(replace(second, channels=channels, modes=modes))
    assert after.modes[0].information[0, 0] > before.modes[0].information[0, 0]
    assert np.array_equal(after.modes[0].information[1:, 1:], before.modes[0].information[1:, 1:])


def test_a_close_pair_says_its_mean_frequency_and_nothing_of_shapes():
    estimate = windows(1, seed=11)[0]
    a, b = (replace(mode, pair_id="p") for mode in estimate.modes[:2])
    pair = combined([replace(estimate, modes=(a, b, estimate.modes[2]))]).modes[0]
    assert pair.close_pair
    assert pair.frequency == pytest.approx((a.frequency + b.frequency) / 2)
    assert pair.known.tolist() == [True] + [False] * len(LAYOUT.channels)


def test_a_mode_that_jumps_opens_a_new_one_instead_of_spoiling_the_old():
    estimate = windows(1, seed=12)[0]
    moved = tuple(replace(mode, frequency=mode.frequency * 1.02) for mode in estimate.modes)
    evidence = combined([estimate, replace(estimate, modes=moved)])
    assert len(evidence.modes) == 2 * len(LABELS)


def test_intervals_from_few_time_blocks_are_widened_for_it():
    estimate = windows(1, seed=13)[0]
    known = combined([estimate])
    estimated = combined(
        [replace(estimate, modes=tuple(_of_blocks(m, 20) for m in estimate.modes))]
    )
    ratio = estimated.modes[0].information[0, 0] / known.modes[0].information[0, 0]
    assert ratio == pytest.approx(17 / 19)


def _of_blocks(mode, n_blocks):
    factor = np.hstack([mode.covariance_factor, np.zeros((len(mode.covariance_factor), n_blocks))])
    return replace(mode, covariance_factor=factor, n_block_columns=n_blocks)


@pytest.mark.parametrize(("value", "words"), [(np.nan, "not finite"), (0.0, "not positive")])
def test_a_covariance_that_cannot_be_is_refused_with_the_mode_it_belongs_to(value, words):
    estimate = windows(1, seed=14)[0]
    broken = replace(
        estimate.modes[0], covariance_factor=estimate.modes[0].covariance_factor * value
    )
    with pytest.raises(EstimateRefused, match=words):
        empty().with_estimate(replace(estimate, modes=(broken,)))


def test_a_channel_that_the_layout_does_not_have_is_refused_by_name():
    estimate = replace(windows(1, seed=15)[0], channels=("z999-fa", *LAYOUT.channel_names[1:]))
    with pytest.raises(EstimateRefused, match="z999-fa"):
        empty().with_estimate(estimate)


def noise_of(window, seed):
    """A window with the real modes and one that is none of them."""
    generator = np.random.default_rng([seed, window])
    (estimate,) = windows(1, seed=[seed, window])
    shape = generator.standard_normal(len(LAYOUT.channels))
    spurious = drawn_mode(generator.uniform(0.2, 12), shape, generator, 0.001, 0.01)
    return replace(estimate, window=window, modes=(*estimate.modes, spurious))


def test_spurious_modes_are_forgotten_so_that_years_cost_what_days_do(monkeypatch):
    monkeypatch.setattr(mode_evidence, "MISSED_WINDOWS", 10)
    counts, evidence = [], empty()
    for window in range(200):
        evidence = evidence.with_estimate(noise_of(window, 13))
        counts.append(len(evidence.modes))
    assert max(counts[100:]) <= len(LABELS) + 15
    established = [mode for mode in evidence.modes if mode.n_windows >= 150]
    assert len(established) == len(LABELS)


def test_a_mode_seen_in_every_twentieth_window_is_never_forgotten():
    evidence = empty()
    for window, estimate in enumerate(windows(200, seed=14)):
        if window % 20:
            estimate = replace(estimate, modes=estimate.modes[:2])
        evidence = evidence.with_estimate(estimate)
    assert evidence.modes[2].n_windows == 10


@pytest.mark.parametrize("factor", [0.98, 0.92])
def test_a_mode_whose_frequency_jumps_keeps_its_track_but_not_its_mean(factor):
    evidence = combined(windows(6, seed=15))
    (estimate,) = windows(1, seed=16)
    moved = tuple(replace(mode, frequency=mode.frequency * factor) for mode in estimate.modes)
    after = evidence.with_estimate(replace(estimate, modes=moved))
    tracks = [mode.track for mode in evidence.modes]
    assert sorted(mode.track for mode in after.modes) == sorted(tracks * 2)
    for mode in evidence.modes:
        same = [each for each in after.modes if each.track == mode.track]
        assert len(same) == 2
        assert min(each.frequency for each in same) == pytest.approx(factor * mode.frequency, 2e-3)


def test_a_close_sister_seen_in_the_same_window_is_no_jump():
    evidence = combined(windows(6, seed=17))
    (estimate,) = windows(1, seed=18)
    sister = replace(estimate.modes[0], frequency=estimate.modes[0].frequency * 1.02)
    after = evidence.with_estimate(replace(estimate, modes=(*estimate.modes, sister)))
    assert len({mode.track for mode in after.modes}) == len(LABELS) + 1


def test_what_a_later_window_sees_beside_the_missed_mode_was_no_jump():
    """A neighbour first seen while a mode is missed takes its track only until both are seen."""
    evidence = combined(windows(6, seed=19))
    first, second = windows(2, seed=20)
    neighbours = [
        replace(w.modes[0], frequency=w.modes[0].frequency * 1.02) for w in (first, second)
    ]
    missed = replace(first, modes=(neighbours[0], *first.modes[1:]))
    both = replace(second, modes=(*second.modes, neighbours[1]))
    mistaken = evidence.with_estimate(missed)
    assert len({mode.track for mode in mistaken.modes}) == len(LABELS)
    after = mistaken.with_estimate(both)
    tracks = {round(mode.frequency, 3): mode.track for mode in after.modes}
    assert len(set(tracks.values())) == len(after.modes) == len(LABELS) + 1
    kept = [mode.track for mode in after.modes if mode.n_windows == 7]
    assert kept[0] == evidence.modes[0].track


def test_a_missed_mode_that_returns_had_not_jumped():
    """Two modes that are seen by turns, never both, are two."""
    evidence = combined(windows(6, seed=19))
    missed, again, other = windows(3, seed=20)
    neighbour = replace(missed.modes[0], frequency=missed.modes[0].frequency * 1.02)
    mistaken = evidence.with_estimate(replace(missed, modes=(neighbour, *missed.modes[1:])))
    assert len({mode.track for mode in mistaken.modes}) == len(LABELS)
    after = mistaken.with_estimate(again)
    assert len({mode.track for mode in after.modes}) == len(after.modes) == len(LABELS) + 1
    assert [m.track for m in after.modes if m.n_windows > 1] == [m.track for m in evidence.modes]
    later = after.with_estimate(replace(other, modes=(neighbour, *other.modes[1:])))
    assert len({mode.track for mode in later.modes}) == len(LABELS) + 1


def test_a_neighbour_missed_since_an_event_is_not_taken_for_the_mode_beside_it():
    """Less than one per cent apart, of like shape, seen by turns after the evidence began again."""
    all_seen = windows(6, seed=19)
    beside = [replace(w.modes[0], frequency=w.modes[0].frequency * 1.008) for w in all_seen]
    both = [replace(w, modes=(*w.modes, b)) for w, b in zip(all_seen, beside, strict=True)]
    before = combined(both)
    neighbour = before.modes[1]
    assert neighbour.frequency == pytest.approx(1.008 * before.modes[0].frequency, rel=2e-3)
    since = combined(all_seen[-1:]).continuing(combined([*both[:-1], all_seen[-1]]))
    assert [mode.track for mode in since.former] == [neighbour.track]
    later = since.with_estimate(replace(all_seen[0], modes=(beside[0], *all_seen[0].modes[1:])))
    assert later.former == ()
    assert len(later.modes) == len(LABELS) + 1
    (found,) = (mode for mode in later.modes if mode.track == neighbour.track)
    assert found.frequency == pytest.approx(beside[0].frequency)
    assert found.n_windows == 1


def test_a_mode_that_has_jumped_stays_on_its_track():
    evidence = combined(windows(6, seed=15))
    for estimate in windows(4, seed=16):
        moved = tuple(replace(mode, frequency=mode.frequency * 0.97) for mode in estimate.modes)
        evidence = evidence.with_estimate(replace(estimate, modes=moved))
    assert len(evidence.modes) == 2 * len(LABELS)
    assert len({mode.track for mode in evidence.modes}) == len(LABELS)


def test_a_mode_that_most_windows_miss_does_not_jump():
    """Another one of like shape, seen beside its absence, is another one."""
    rare, *others = windows(6, seed=21)
    without = [replace(each, modes=each.modes[1:]) for each in others]
    evidence = combined([rare, without[0], others[1], *without[2:]])
    (estimate,) = windows(1, seed=22)
    other = replace(estimate.modes[0], frequency=estimate.modes[0].frequency * 1.02)
    after = evidence.with_estimate(replace(estimate, modes=(other, *estimate.modes[1:])))
    assert len({mode.track for mode in after.modes}) == len(LABELS) + 1


def test_of_two_modes_on_one_track_the_one_that_most_windows_saw_stands_for_it():
    evidence = combined(windows(6, seed=15))
    (estimate,) = windows(1, seed=16)
    jumped = replace(estimate.modes[0], frequency=estimate.modes[0].frequency * 1.02)
    after = evidence.with_estimate(replace(estimate, modes=(jumped,)))
    chosen = after.one_a_track(range(len(after.modes)))
    assert len(after.modes) == len(LABELS) + 1
    assert [after.modes[place].n_windows for place in sorted(chosen)] == [6] * len(LABELS)


def under_water(estimate, rise, slope, curvature):
    """The estimate with every frequency as the water moves it."""
    factor = np.exp(slope * rise + curvature * rise**2)
    modes = [replace(mode, frequency=factor * mode.frequency) for mode in estimate.modes]
    return replace(estimate, modes=tuple(modes), water_level=rise)


@pytest.mark.parametrize("joint_covariance", [False, True])
def test_windows_of_any_water_level_say_what_they_would_have_said_at_the_models(joint_covariance):
    """Up to 1.5 m at .5 % a metre; the errors are the same in both."""
    rises = [1.5, 1.0, 0.4, -0.1, 0.5, 1.0]
    still = combined(windows(6, seed=41), joint_covariance=joint_covariance)
    evidence = empty(joint_covariance)
    for estimate, rise in zip(windows(6, seed=41), rises, strict=True):
        risen = under_water(estimate, rise, -0.005, -0.0008)
        evidence = evidence.with_estimate(risen, rise=rise)
    assert evidence.level_varied
    assert not still.level_varied
    levels = np.array([-1.0, 0.0, 1.0])
    partner = PartnerInWater(-0.005 * levels - 0.0008 * levels**2, np.ones((3, 8)))
    reduced = evidence.at_model_level([partner] * 3)
    for before, one, other in zip(evidence.modes, reduced.modes, still.modes, strict=True):
        assert abs(before.frequency / other.frequency - 1) > 0.003
        assert one.frequency == pytest.approx(other.frequency, rel=3e-5)  # 1 % of what was moved
        assert one.shape == pytest.approx(other.shape, abs=2e-3)
        assert one.covariance == pytest.approx(other.covariance, nan_ok=True)


def test_a_shape_that_turns_with_the_water_is_turned_back():
    """Two windows, at 1 m and at 2 m, whose shapes lie on the partner's line of the level."""
    estimate = windows(1, seed=42, shape_std=1e-4)[0]
    mode = estimate.modes[0]
    turning = np.linspace(0.0, 0.02, 8)  # of φ a metre
    evidence = empty()
    for rise in (1.0, 2.0):
        shape = mode.shape + rise * turning
        risen = replace(estimate, modes=(replace(mode, shape=shape / shape[mode.unit_component]),))
        evidence = evidence.with_estimate(risen, rise=rise)
    levels = np.array([-1.0, 0.0, 1.0])[:, None]
    partner = PartnerInWater(np.zeros(3), mode.shape + levels * turning)
    assert np.abs(evidence.modes[0].shape - mode.shape).max() > 0.01
    reduced = evidence.at_model_level([partner])
    assert reduced.modes[0].shape == pytest.approx(mode.shape, abs=1e-3)
