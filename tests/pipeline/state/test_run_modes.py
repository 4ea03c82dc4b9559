"""One entry a mode of a whole session: weighted by precision, named after the model's."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior, ModalEstimate, Mode, ModePair
from pipeline.state.run_modes import CombinedTracks
from sensors.acquisition.blocks import NANOSECONDS

WINDOW = 600 * NANOSECONDS


def mode(name: str, frequency: float, std: float, *, pair_id: str = "") -> Mode:
    """A mode of two channels of which only the frequency and its std matter."""
    factor = np.zeros((4, 1))
    factor[0, 0] = std
    shape = np.array([1.0, frequency])
    return Mode(name, frequency, std, 0.01, 0.001, shape, factor, 1, pair_id=pair_id)


def estimate(window: int, *modes: Mode, **changes: object) -> ModalEstimate:
    whole = ModalEstimate(
        "t1", window, window * WINDOW, (window + 1) * WINDOW, "layout", ("a", "b"), modes
    )
    return replace(whole, **changes)


def test_a_track_is_one_mode_weighted_by_its_precision() -> None:
    windows = [estimate(0, mode("m1", 1.0, 0.1)), estimate(1, mode("m1", 1.3, 0.2))]
    (combined,) = CombinedTracks(windows).modes()
    assert combined.frequency == pytest.approx((1.0 / 0.01 + 1.3 / 0.04) / (1 / 0.01 + 1 / 0.04))
    assert combined.frequency_std == pytest.approx((1 / 0.01 + 1 / 0.04) ** -0.5)
    assert combined.seen_in_windows == 2
    assert combined.shape == (1.0, 1.0)  # of the window that saw it sharpest


def test_windows_that_overlap_count_their_samples_once() -> None:
    same = [estimate(k, mode("m1", 1.0, 0.1), weight=0.1) for k in range(10)]
    (combined,) = CombinedTracks(same).modes()
    assert combined.frequency_std == pytest.approx(0.1)


def posterior(*pairs: ModePair) -> FoundationPosterior:
    """A posterior of which only pairs and model modes matter: "1" side-side, "2" fore-aft, "5"."""
    return FoundationPosterior(
        turbine="t1",
        window=0,
        time_ns=WINDOW,
        n_windows=1,
        parameters=(),
        correlation=np.eye(3),
        draws=np.zeros((0, 4)),
        pairs=pairs,
        model_labels=("1", "2", "5"),
        model_frequencies=np.array([0.1573, 0.1586, 1.0997]),
        model_shapes=np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 0.5]]),
        sampler="importance",
        ess=1000.0,
        rhat=1.0,
        autocorrelation_time=float("nan"),
        reduced_chi_square=1.0,
        paired_share=1.0,
        pairing_cost=0.1,
    )


def test_a_paired_mode_goes_by_the_models_name() -> None:
    pair = ModePair("m2", "5", 1.1, 0.001, 1.0997, 0.999, shape_used=True)
    window = estimate(0, mode("m1", 0.5, 0.1), mode("m2", 1.1, 0.1))
    named = [each.as_json() for each in CombinedTracks([window]).modes(posterior(pair))]
    assert [each["name"] for each in named] == ["m1", "5"]
    assert [each["model_frequency_hz"] for each in named] == [None, 1.0997]
    assert [each["mac_to_model"] for each in named] == [None, 0.999]


def test_two_modes_that_cannot_be_separated_go_by_their_shapes() -> None:
    side = replace(mode("m1", 0.158, 0.001, pair_id="p"), shape=np.array([0.1, 1.0]))
    fore = replace(mode("m2", 0.158, 0.001, pair_id="p"), shape=np.array([1.0, -0.1]))
    pair = ModePair("m1+m2", "2", 0.158, 0.001, 0.1586, float("nan"), shape_used=False)
    entries = [
        each.as_json() for each in CombinedTracks([estimate(0, side, fore)]).modes(posterior(pair))
    ]
    assert [each["pair_id"] for each in entries] == ["p", "p"]
    assert [each["name"] for each in entries] == ["1", "2"]
    assert [each["model_frequency_hz"] for each in entries] == [0.1573, 0.1586]
    assert all(each["mac_to_model"] == pytest.approx(1 / 1.01) for each in entries)


def test_of_a_rough_model_the_farther_mode_is_found_by_its_shape_too() -> None:
    """On main before, both were called SS1, one of them with a MAC of .001."""
    side = replace(mode("m1", 0.155, 0.0005, pair_id="p"), shape=np.array([0.03, 1.0]))
    fore = replace(mode("m2", 0.155, 0.0005, pair_id="p"), shape=np.array([1.0, -0.03]))
    pair = ModePair("m1+m2", "1", 0.155, 0.0005, 0.1573, 1.0, shape_used=False)
    combined = CombinedTracks([estimate(0, side, fore)]).modes(posterior(pair))
    assert [each.name for each in combined] == ["1", "2"]
    assert [each.pair.mac for each in combined if each.pair] == pytest.approx([1 / 1.0009] * 2)


def test_a_mode_that_some_windows_separate_keeps_the_pair_of_its_own() -> None:
    """It had the misfit of the pair, and the other one often the same name."""
    side = replace(mode("m1", 0.157, 0.001, pair_id="p"), shape=np.array([0.9, 1.0]))
    fore = replace(mode("m2", 0.158, 0.001), shape=np.array([1.0, -0.1]))
    merged = ModePair("m1+m2", "1", 0.1575, 0.001, 0.1573, 1.0, shape_used=False, misfit=-0.3)
    own = ModePair("m2", "2", 0.158, 0.001, 0.1586, 0.99, shape_used=True, misfit=9.5)
    for pairs in ((merged, own), (own, merged)):
        combined = CombinedTracks([estimate(0, side, fore)]).modes(posterior(*pairs))
        assert [each.name for each in combined] == ["1", "2"]
        assert [each.pair.misfit for each in combined if each.pair] == [-0.3, 9.5]


def test_two_modes_of_one_pair_are_two_modes_of_the_model() -> None:
    first = replace(mode("m1", 0.157, 0.001, pair_id="p"), shape=np.array([1.0, 0.4]))
    other = replace(mode("m2", 0.158, 0.001, pair_id="p"), shape=np.array([1.0, -0.1]))
    pair = ModePair("m1+m2", "2", 0.1575, 0.001, 0.1586, 1.0, shape_used=False)
    combined = CombinedTracks([estimate(0, first, other)]).modes(posterior(pair))
    assert [each.name for each in combined] == ["1", "2"]


def test_an_unknown_std_is_null_and_not_nan() -> None:
    (combined,) = CombinedTracks([estimate(0, mode("m1", 1.0, float("nan")))]).modes()
    assert combined.as_json()["frequency_std_hz"] is None


def test_shapes_are_compared_channel_by_channel_also_where_their_order_changed() -> None:
    """A logger comes back with its channels backwards; "m1" was seen before that alone."""
    side = replace(mode("m1", 0.158, 0.001, pair_id="p"), shape=np.array([0.1, 1.0]))
    fore = replace(mode("m2", 0.158, 0.001, pair_id="p"), shape=np.array([-0.1, 1.0]))
    windows = [estimate(0, side), estimate(1, fore, channels=("b", "a"))]
    pair = ModePair("m1+m2", "2", 0.158, 0.001, 0.1586, float("nan"), shape_used=False)
    whole = posterior(pair)
    backwards = replace(whole, time_ns=2 * WINDOW, model_shapes=whole.model_shapes[:, ::-1])
    combined = CombinedTracks(windows).modes(backwards)
    assert [each.name for each in combined] == ["1", "2"]
    assert [each.channels for each in combined] == [("a", "b"), ("b", "a")]


def test_a_pair_of_two_modes_keeps_its_name_where_the_posteriors_channels_are_not_known() -> None:
    side, fore = (mode(name, 0.158, 0.001, pair_id="p") for name in ("m1", "m2"))
    pair = ModePair("m1+m2", "2", 0.158, 0.001, 0.1586, float("nan"), shape_used=False)
    unheard = replace(posterior(pair), time_ns=7 * WINDOW)
    combined = CombinedTracks([estimate(0, side, fore)]).modes(unheard)
    assert [each.name for each in combined] == ["2", "2"]
