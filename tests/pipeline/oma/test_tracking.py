"""Modes keep their names over drift, crossings and missing windows."""

import time
from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.tracking import DIES_AFTER, ModeTracker, _common_mac

FREQUENCIES = np.array([0.1586, 0.63, 1.0764, 1.0997, 1.816, 2.5782, 2.5983, 3.8, 5.86, 10.47])


def estimate(frequency: float, shape: np.ndarray, std: float) -> Mode:
    factor = np.zeros((2 + len(shape), 1))
    factor[0] = std
    return Mode(
        name="",
        frequency=frequency,
        frequency_std=std,
        damping_ratio=0.008,
        damping_ratio_std=0.002,
        shape=shape / shape[np.argmax(np.abs(shape))],
        covariance_factor=factor,
        n_block_columns=1,
    )


def a_day_of_estimates(
    generator: np.random.Generator, *, missing_windows: float, missing_modes: float
) -> list[list[tuple[int, Mode]]]:
    """144 windows of ten modes, (true identity, estimate), none in a missing window.

    All frequencies fall by 5 % over the day but that of the sixth mode, which stays, so that the
    seventh crosses it. Estimates scatter by their std, shapes by 5 %.
    """
    shapes = generator.standard_normal((len(FREQUENCIES), 8))
    std = np.sqrt(0.008 / (2 * np.pi * FREQUENCIES * 600)) * FREQUENCIES * 1.5
    windows = []
    for k in range(144):
        ramp = np.full(len(FREQUENCIES), 1 - 0.05 * k / 143)
        ramp[5] = 1.0
        f = FREQUENCIES * ramp + std * generator.standard_normal(len(FREQUENCIES))
        noisy = shapes + 0.05 * generator.standard_normal(shapes.shape)
        seen = [i for i in range(len(f)) if generator.random() > missing_modes]
        lost = generator.random() < missing_windows
        window = [] if lost else [(i, estimate(f[i], noisy[i], std[i])) for i in seen]
        windows.append(sorted(window, key=lambda entry: entry[1].frequency))
    return windows


def names_of_identities(windows: Sequence[Sequence[tuple[int, Mode]]]) -> dict[int, set[str]]:
    tracker = ModeTracker()
    names: dict[int, set[str]] = {}
    for window in windows:
        if not window:
            tracker.missed()
            continue
        named = tracker.named([mode for _, mode in window])
        for (identity, _), mode in zip(window, named, strict=True):
            names.setdefault(identity, set()).add(mode.name)
    return names


@pytest.mark.parametrize("seed", range(10))
def test_no_identity_is_switched_in_a_day_of_drift_crossings_and_gaps(seed: int) -> None:
    windows = a_day_of_estimates(
        np.random.default_rng(seed), missing_windows=0.2, missing_modes=0.1
    )
    names = names_of_identities(windows)
    assert all(len(own) == 1 for own in names.values())
    assert len(set.union(*names.values())) == len(FREQUENCIES)


def test_a_mode_not_seen_for_long_dies_and_its_name_is_not_used_again() -> None:
    tracker = ModeTracker()
    shape = np.array([1.0, 0.5])
    for _ in range(6):
        tracker.named([estimate(1.0, shape, 0.001)])
    deaths = []
    for _ in range(DIES_AFTER + 1):
        tracker.missed()
        deaths += [event for event in tracker.events if event.kind == "death"]
    assert [event.name for event in deaths] == ["m1"]
    assert tracker.named([estimate(1.0, shape, 0.001)])[0].name == "m2"


def test_a_drift_of_two_percent_is_reported() -> None:
    tracker = ModeTracker()
    texts = []
    for k in range(60):
        tracker.named([estimate(1.0 - 0.02 * k / 59, np.array([1.0, 0.5]), 0.001)])
        texts += [event.text for event in tracker.events]
    assert texts
    assert texts[0].startswith("m1 has drifted by -1")


def test_a_new_mode_is_reported_once_the_first_windows_are_over() -> None:
    tracker = ModeTracker()
    known, new = estimate(1.0, np.array([1.0, 0.5]), 0.001), estimate(1.4, np.ones(2), 0.001)
    for _ in range(8):
        tracker.named([known])
        assert tracker.events == ()
    tracker.named([known, new])
    assert [(event.kind, event.name) for event in tracker.events] == [("birth", "m2")]


@pytest.mark.parametrize(("windows_away", "name"), [(21, "m1"), (144, "m2")])
def test_a_mode_keeps_its_name_over_a_storm_of_hours_but_not_over_a_day(
    windows_away: int, name: str
) -> None:
    """Windows of ten minutes: three and a half hours against twenty-four."""
    tracker = ModeTracker()
    shape = np.array([1.0, 0.5])
    for _ in range(6):
        tracker.named([estimate(1.0, shape, 0.001)])
    for _ in range(windows_away):
        tracker.missed()
    assert tracker.named([estimate(1.0, shape, 0.001)])[0].name == name


def test_the_mac_of_many_shapes_is_over_the_channels_that_each_pair_has() -> None:
    generator = np.random.default_rng(4)
    ones, others = generator.standard_normal((5, 8)), generator.standard_normal((7, 8))
    ones[1, 2:5] = np.nan
    others[3, 0] = np.nan
    others[4, :2] = np.nan
    ones[2, 2:] = np.nan  # no channel in common with the fifth of the others
    others[6] = 0.0

    found = _common_mac(ones, others)

    for i, one in enumerate(ones):
        for j, other in enumerate(others):
            both = np.isfinite(one) & np.isfinite(other)
            pair = one[None, both], other[None, both]
            expected = modal_assurance_criterion(*pair)[0, 0] if both.any() else 1.0
            assert found[i, j] == pytest.approx(expected, abs=1e-12)


def test_a_window_of_forty_modes_is_named_in_some_milliseconds() -> None:
    """An archive of ten years has half a million windows; 30 ms each would be four hours."""
    generator = np.random.default_rng(5)
    shapes = generator.standard_normal((40, 8))
    modes = [estimate(0.2 + 0.3 * i, shape, 1e-3) for i, shape in enumerate(shapes)]
    tracker = ModeTracker()
    tracker.named(modes)

    started = time.process_time()
    for _ in range(20):
        tracker.named(modes)

    assert (time.process_time() - started) / 20 < 0.01  # of a busy machine; 2 ms alone
