"""Lag covariances with a few channels find the modes that those with all channels find."""

import logging
import warnings

import numpy as np
import pytest

from pipeline.app import Outputs, build
from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.oma.settings import OmaSettings, OmaSettingsError
from pipeline.oma.ssi.ssi_cov import (
    ALL,
    references_among,
    settings_for_channels,
    with_bounded_references,
)
from pipeline.scenario import ScenarioError, scenario_from_text
from sensors.arrays import FloatArray
from tests.pipeline.oma.conftest import KnownStructure, structure

RATE = 40.0  # [Hz]
NAMES = ("foot", "lower", "middle", "upper", "top")


@pytest.fixture(scope="module")
def seen_by_all(cantilever: KnownStructure) -> tuple[FloatArray, tuple[Mode, ...]]:
    """Samples, and their modes by all channels."""
    y = cantilever.ambient_response(sampling_rate=RATE, duration=300.0, seed=31)
    return y, identify(y, RATE, channel_names=NAMES).modes


@pytest.mark.parametrize("references", [("top",), ("top", "lower")])
def test_few_references_find_the_modes_of_all_within_the_joint_std(
    cantilever: KnownStructure,
    seen_by_all: tuple[FloatArray, tuple[Mode, ...]],
    references: tuple[str, ...],
) -> None:
    y, full = seen_by_all
    settings = OmaSettings(reference_channels=references)
    reduced = identify(y, RATE, settings, channel_names=NAMES).modes
    for frequency, shape in zip(cantilever.frequencies, cantilever.shapes, strict=True):
        one, other = (
            min(modes, key=lambda m: abs(m.frequency - frequency)) for modes in (full, reduced)
        )
        for mode in (one, other):
            assert abs(mode.frequency - frequency) < 4 * mode.frequency_std
        joint_std = np.hypot(one.frequency_std, other.frequency_std)
        assert abs(one.frequency - other.frequency) < 2 * joint_std
        assert abs(one.damping_ratio - other.damping_ratio) < 3 * np.hypot(
            one.damping_ratio_std, other.damping_ratio_std
        )
        assert len(other.shape) == 5
        assert modal_assurance_criterion(other.shape[None], shape[None])[0, 0] > 0.99


def test_all_channels_named_are_no_references_named(
    seen_by_all: tuple[FloatArray, tuple[Mode, ...]],
) -> None:
    y, full = seen_by_all
    settings = OmaSettings(reference_channels=NAMES)
    named = identify(y, RATE, settings, channel_names=NAMES).modes
    for one, other in zip(named, full, strict=True):
        assert one.frequency == pytest.approx(other.frequency, rel=1e-10)


def test_references_are_found_by_name() -> None:
    assert references_among(NAMES, OmaSettings()) == ALL
    chosen = references_among(NAMES, OmaSettings(reference_channels=("top", "foot")))
    np.testing.assert_array_equal(chosen, [4, 0])


def test_an_unknown_reference_is_one_line_with_the_names_there_are() -> None:
    settings = OmaSettings(reference_channels=("top", "roof"))
    with pytest.raises(OmaSettingsError, match="'roof'; the channels are foot, lower"):
        references_among(NAMES, settings)
    with pytest.raises(OmaSettingsError, match="the channels are channel 1, channel 2"):
        identify(np.zeros((100, 2)), RATE, settings)


@pytest.mark.parametrize(("names", "reason"), [((), "is empty"), (("top", "top"), "'top' twice")])
def test_no_reference_or_one_twice_is_refused(names: tuple[str, ...], reason: str) -> None:
    with pytest.raises(OmaSettingsError, match=reason):
        OmaSettings(reference_channels=names)


def test_a_window_without_some_channels_keeps_the_references_that_are_left() -> None:
    settings = OmaSettings(reference_channels=("top", "foot"))
    assert settings_for_channels(settings, NAMES[:3]).reference_channels == ("foot",)
    assert settings_for_channels(settings, NAMES[1:3]).reference_channels is None
    assert settings_for_channels(OmaSettings(), NAMES) == OmaSettings()


def test_a_scenario_names_its_references() -> None:
    scenario = scenario_from_text('[oma]\nreference_channels = ["z145-fa", "z145-ss"]', "mine.toml")
    assert scenario.oma.reference_channels == ("z145-fa", "z145-ss")
    with pytest.raises(ScenarioError, match=r"reference_channels\[1\] is 3"):
        scenario_from_text('[oma]\nreference_channels = ["z145-fa", 3]', "mine.toml")


def test_a_session_with_an_unknown_reference_does_not_begin() -> None:
    scenario = scenario_from_text('[oma]\nreference_channels = ["z145-fa", "roof"]', "mine.toml")
    with pytest.raises(OmaSettingsError, match="'roof'; the channels are z41-fa, "):
        build(scenario, scenario.layout, Outputs())


@pytest.mark.peer
def test_pyoma_finds_the_same_modes_with_the_same_references(cantilever: KnownStructure) -> None:
    algorithms = pytest.importorskip("pyoma2.algorithms")
    setup_of = pytest.importorskip("pyoma2.setup").SingleSetup
    y = cantilever.ambient_response(sampling_rate=RATE, duration=300.0, seed=33)
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        setup = setup_of(y.copy(), fs=RATE)
        setup.add_algorithms(
            algorithms.SSI(name="ssi", method="cov", br=60, ordmax=40, step=2, ref_ind=[4, 1])
        )
        setup.run_by_name("ssi")
        poles = setup["ssi"].result
    logging.disable(logging.NOTSET)
    settings = OmaSettings(reference_channels=("top", "lower"))
    modes = identify(y, RATE, settings, channel_names=NAMES).modes
    assert len(modes) >= 3
    for mode in modes:
        theirs = int(np.nanargmin(np.abs(poles.Fn_poles[:, -1] - mode.frequency)))
        assert abs(poles.Fn_poles[theirs, -1] - mode.frequency) < 3 * mode.frequency_std
        shape = np.real(poles.Phi_poles[theirs, -1])
        assert modal_assurance_criterion(mode.shape[None], shape[None])[0, 0] > 0.98


def many_channels(n_channels: int, n_dead: int = 0) -> tuple[KnownStructure, FloatArray]:
    """Six modes at many places, four of which feel nothing but their own noise."""
    generator = np.random.default_rng(12)
    shapes = generator.standard_normal((6, n_channels))
    known = structure([0.9, 1.7, 2.6, 3.8, 5.1, 6.9], 0.01, shapes)
    samples = known.ambient_response(sampling_rate=20.0, duration=400.0, seed=5)
    samples[:, 4:8] = generator.standard_normal((len(samples), 4))
    samples[:, :n_dead] = 0.0
    return known, samples


def test_of_many_channels_those_are_references_that_explain_the_others() -> None:
    _, samples = many_channels(100, n_dead=2)
    names = tuple(f"c{number}" for number in range(100))
    chosen = with_bounded_references(samples, names, OmaSettings()).reference_channels
    assert chosen is not None
    assert len(chosen) == 10
    assert not {"c0", "c1"} & set(chosen)  # dead ones
    six = with_bounded_references(samples[:, :40], names[:40], OmaSettings()).reference_channels
    assert six is not None
    assert len(six) == 25
    first_six = samples[:, [names.index(name) for name in chosen]]
    assert np.linalg.matrix_rank(np.corrcoef(first_six.T), tol=0.1) >= 6


def test_noise_alone_is_no_reference_while_modes_are_left() -> None:
    _, samples = many_channels(200)  # five references at most
    names = tuple(f"c{number}" for number in range(200))
    chosen = with_bounded_references(samples, names, OmaSettings()).reference_channels
    assert chosen is not None
    assert len(chosen) == 5
    assert not {f"c{number}" for number in range(4, 8)} & set(chosen)


def test_channels_that_are_few_or_named_stay_as_they_are() -> None:
    _, samples = many_channels(40)
    names = tuple(f"c{number}" for number in range(40))
    named = OmaSettings(reference_channels=("c3", "c9"))
    assert with_bounded_references(samples, names, named) is named
    few = OmaSettings()
    assert with_bounded_references(samples[:, :32], names[:32], few) is few


@pytest.mark.nightly
def test_a_hundred_channels_show_the_modes_that_they_have() -> None:
    known, samples = many_channels(100)
    modes = identify(samples, 20.0).modes
    felt, found = [*range(4), *range(8, 100)], 0
    for frequency, shape in zip(known.frequencies, known.shapes, strict=True):
        mode = min(modes, key=lambda m: abs(m.frequency - frequency))
        if abs(mode.frequency - frequency) < max(4 * mode.frequency_std, 0.002 * frequency):
            mac = modal_assurance_criterion(mode.shape[None, felt], shape[None, felt])[0, 0]
            found += bool(mac > 0.95)
    assert found >= 5
    assert len(modes) <= 6
