"""What looked like a mode and is not reported: every column of the diagram has a name."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.messages import Mode, RefusedMode
from pipeline.oma import band_merging, identification
from pipeline.oma.identification import identify, why_refused
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.stabilization import PoleCloud
from tests.benchmarks.close_modes import pair
from tests.pipeline.oma.conftest import KnownStructure
from tests.tiers import and_at_night


def test_columns_of_poles_are_modes_or_refused_with_a_reason() -> None:
    record = pair(60_001, 0.01)
    found = identify(record.samples[:3000], record.sampling_rate)
    named = [*(m.frequency for m in found.modes), *(r.frequency for r in found.refused)]
    for poles in found.diagrams:
        for frequency in poles.frequencies:
            near = np.abs(poles.frequencies / frequency - 1) <= 0.005
            orders = len(np.unique(poles.orders[near]))
            is_named = np.abs(np.array(named) / frequency - 1).min() <= 0.02
            assert is_named or orders < max(2, 0.6 * len(np.unique(poles.orders)))


@pytest.mark.parametrize("seeds", and_at_night((60_001, 60_004), (60_002, 60_003, 60_005)))
def test_each_refusal_has_a_code_and_a_sentence_with_a_figure(seeds: tuple[int, ...]) -> None:
    found = [
        each for seed in seeds for each in identify(pair(seed, 0.005).samples[:4000], 20.0).refused
    ]
    assert found
    for each in found:
        assert each.code.isidentifier()
        assert each.code == "harmonic" or any(letter.isdigit() for letter in each.text)


def test_a_column_that_two_bands_see_is_named_once_by_the_band_with_more_of_its_orders(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    columns = {
        "slow": [(0.5, RefusedMode(1.001, 0.01, "unstable", "slow"))],
        "fast": [
            (0.2, RefusedMode(1.0, 0.01, "unstable", "fast")),
            (0.3, RefusedMode(3.0, 0.01, "unstable", "fast")),
        ],
    }
    monkeypatch.setattr(band_merging, "_columns", lambda band, _: columns[band])
    found = band_merging.unstable(["fast", "slow"], (), ())
    assert [(each.frequency, each.text) for each in found] == [(1.001, "slow"), (3.0, "fast")]


def test_what_the_lines_alone_show_is_listed_where_nothing_else_is(
    two_mass_system: KnownStructure, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = two_mass_system.ambient_response(sampling_rate=10.0, duration=200.0, seed=9)
    before = identify(samples, 10.0)
    places = [before.modes[0].frequency, before.refused[0].frequency, 4.0, 4.01, 2.0]
    unseen = [RefusedMode(place, 0.01, "uncertain", "") for place in places]
    monkeypatch.setattr(identification, "with_unseen", lambda modes, *_, **__: (modes, unseen))
    after = identify(samples, 10.0)
    expected = sorted([*before.refused, unseen[2], unseen[4]], key=lambda each: each.frequency)
    assert list(after.refused) == expected
    assert [each.frequency for each in after.modes] == [each.frequency for each in before.modes]


@pytest.mark.parametrize(("half_bandwidths", "code"), [(2.5, None), (3.5, "mixture")])
def test_a_vague_shape_is_a_mixture_only_where_the_window_resolves_the_resonance(
    half_bandwidths: float, code: str | None
) -> None:
    """Below ζ f T = 3 the window does not resolve the resonance of the mode itself."""
    columns = np.zeros((4, 1))
    columns[:, 0] = [1e-3, 1e-4, 0.0, 2 * OmaSettings().maximum_shape_std]
    mode = Mode("", 1.0, 1e-3, 0.01, 1e-4, np.array([1.0, 0.5]), columns, 1)
    refused = why_refused(mode, half_bandwidths / 0.01, OmaSettings())
    assert (refused and refused[0]) == code


def band(n_orders: int, columns: list[tuple[float, int]]) -> Any:
    """A band with poles at each of these frequencies in so many of its orders."""
    frequencies = np.concatenate([np.full(n, f) for f, n in columns])
    orders = np.concatenate([np.arange(n) for _, n in columns])
    n = len(orders)
    poles = PoleCloud(
        orders=orders,
        indices=np.zeros(n, dtype=int),
        frequencies=frequencies,
        damping_ratios=np.full(n, 0.02),
        shapes=np.ones((n, 1), dtype=complex),
        frequency_deviations=np.zeros((n, 0)),
        damping_deviations=np.zeros((n, 0)),
    )
    return SimpleNamespace(poles=poles, band=SimpleNamespace(orders=range(n_orders)))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("share", "covered"), [(0.98, True), (1.02, False)])
def test_a_column_belongs_to_a_named_mode_within_a_hundredth_of_its_frequency(
    side: int, share: float, covered: bool
) -> None:
    named = np.array([2.0 / (1 + side * share * band_merging.COVERED), 5.0])
    found = band_merging._columns(band(10, [(2.0, 8)]), named)
    assert [each.frequency for _, each in found] == ([] if covered else [2.0])


def test_a_column_has_its_share_of_the_orders_and_its_own_median_and_scatter() -> None:
    seen = band(10, [(1.0, 5), (1.002, 4), (3.0, 3), (4.0, 2)])
    (first, one), (second, two) = band_merging._columns(seen, np.array([]))
    assert (first, second) == (0.5, 0.3)
    assert (one.frequency, two.frequency) == (1.0, 3.0)
    assert (one.damping_ratio, one.code) == (0.02, "unstable")
    spread = 100 * np.std([1.0] * 5 + [1.002] * 4)
    assert f"poles in 5 of 10 model orders, scattered by {spread:.2g} %" in one.text
