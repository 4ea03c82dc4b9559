"""The joint inference on modal data of another simulator: intervals, pairs, faults, checks."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.transport.codec import decode, encode
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural import refresh
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.joint_fit import FEW_STARTS, JointFit
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.periods.relative_change import relative_springs
from pipeline.updating.structural.posterior import figure_errors
from pipeline.updating.structural.refresh import JointRefresh, joint_refresh
from pipeline.updating.structural.sensors.faults import ALL_TURNED
from pipeline.updating.structural.sensors.figures import HEADING_STD
from pipeline.updating.structural.settings import CHOICES, UNCERTAIN
from pipeline.updating.structural.water_level import at_model_level
from pipeline.updating.updater import FoundationUpdater
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import TurbineDescription, load_turbine
from tests.benchmarks import structural_uncertainty
from tests.outside.figures import Figures, draw
from tests.outside.instruments import SensorFault, instruments
from tests.outside.modal_data import LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, averaged, converged, detailed

TURBINE = load_turbine("iea15mw_monopile")
SETTINGS = UpdatingSettings(structure=UNCERTAIN)


@pytest.fixture(scope="module")
def inference() -> JointInference:
    return inference_with_open(*CHOICES)


@pytest.fixture(scope="module")
def dry_bending() -> JointInference:
    """With the blades' alternatives only: no flooded monopile, no tubes that shear. A refresh takes
    a third of the time; which structure holds, with all of them, is asked by tests of its own."""
    return inference_with_open("blade_model")


@pytest.fixture(scope="module")
def one_structure_only() -> JointInference:
    """Blades as described as well, and a shorter search for other valleys: for what becomes of the
    place where it ends. By night the same is asked with all of it."""
    return inference_with_open().with_fits(shortly)


def inference_with_open(*choices: str, turbine: TurbineDescription = TURBINE) -> JointInference:
    """Every figure is uncertain; of the alternatives these are."""
    exact = tuple((choice, 0.0) for choice in CHOICES if choice not in choices)
    settings = replace(SETTINGS, structure=replace(UNCERTAIN, stds=exact))
    found = joint_inference(turbine, LAYOUT, settings, seed=1)
    assert found is not None
    return found


def shortly(fit: JointFit) -> JointFit:
    """The fit with one start after the first few instead of nine, and half of the draws."""
    found = copy.copy(fit)
    found.settings = replace(fit.settings, most_starts=FEW_STARTS + 1)
    found._draws, found._drawn_modes = fit._draws[::2], {}
    return found


def truth_of(seed: int, figures: Figures | None = None) -> Truth:
    rng = np.random.default_rng([seed, 1])
    theta = NOMINAL * rng.uniform(0.9, 1.15, 3)
    return Truth(theta, figures or draw(rng), description=converged())


def evidence_of(
    truth: Truth, rng: np.random.Generator, faults: tuple[SensorFault, ...] = ()
) -> ModalEvidence:
    """Of three windows, the level reported."""
    sensed = instruments(LAYOUT, faults)
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    seen = replace(sensed.true, layout_id=LAYOUT.layout_id)
    for estimate in estimates(truth, 3, rng, layout=seen, reported_levels=[0.0] * 3):
        evidence = evidence.with_estimate(estimate)
    return evidence


def refreshed(
    inference: JointInference, truth: Truth, seed: int, faults: tuple[SensorFault, ...] = ()
) -> JointRefresh:
    rng = np.random.default_rng(seed)
    found = joint_refresh(inference, evidence_of(truth, rng, faults), (), rng)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def one_structure(dry_bending: JointInference) -> JointRefresh:
    """Whose description holds."""
    return refreshed(dry_bending, truth_of(7), 7)


@pytest.fixture(scope="module")
def another_structure(dry_bending: JointInference) -> JointRefresh:
    """With figures and springs of its own."""
    return refreshed(dry_bending, truth_of(0), 0)


def test_springs_of_a_drawn_structure_lie_within_their_interval(
    one_structure: JointRefresh, another_structure: JointRefresh
) -> None:
    check_intervals({0: another_structure, 7: one_structure})


@pytest.mark.nightly
def test_springs_of_other_drawn_structures_do_so_too(
    inference: JointInference, dry_bending: JointInference
) -> None:
    check_intervals({seed: refreshed(dry_bending, truth_of(seed), seed) for seed in (1, 2)})
    check_intervals({seed: refreshed(inference, truth_of(seed), seed) for seed in (0, 7)})


def check_intervals(found: dict[int, JointRefresh]) -> None:
    """By the seeds of their structures."""
    z = []
    for seed, each in found.items():
        draws = np.log(each.draws[:, :3] * NOMINAL)
        z.append((draws.mean(axis=0) - np.log(truth_of(seed).theta)) / draws.std(axis=0))
    assert np.abs(z).max() < 3.5
    assert np.sqrt(np.mean(np.square(z))) < 1.7


@pytest.mark.parametrize("open_too", [(), pytest.param(CHOICES, marks=pytest.mark.nightly)])
def test_a_flooded_monopile_is_recognised(open_too: tuple[str, ...]) -> None:
    inference = inference_with_open("flooding", *open_too)
    found = refreshed(inference, truth_of(5, Figures(flooded=True)), 5)
    assert "flooded" in found.best.alternative.name
    assert found.best.weight > 0.99


def test_springs_of_the_other_sign_are_named(
    one_structure_only: JointInference, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A coupling that has left the data, so that no interval of k12 is of any use; they explain
    the sensors, so that none is looked for that is wrong."""

    def searched(*_: Any, **__: Any) -> Any:
        raise AssertionError("looked for one wrong sensor")

    refresh = "pipeline.updating.structural.refresh"
    monkeypatch.setattr(f"{refresh}._Attempt.calls_for_a_fault", lambda *_: True)
    monkeypatch.setattr(f"{refresh}._with_blamed_sensor", searched)
    truth = replace(truth_of(12), sign="embedded-pile")
    found = refreshed(one_structure_only, truth, 12)
    (doubt,) = (each for each in distrust(found, SETTINGS.guards) if each.code == "springs-sign")
    assert 'sign = "published"' in doubt.text
    assert found.other_sign > 0.99


@pytest.mark.parametrize(
    ("sheared", "open_too"),
    [
        pytest.param(False, "blade_model", id="only bend", marks=pytest.mark.nightly),
        pytest.param(True, "blade_model", id="shear, any blades", marks=pytest.mark.nightly),
        pytest.param(True, "", id="shear"),
    ],
)
def test_whether_tubes_shear_is_recognised(sheared: bool, open_too: str) -> None:
    """They are described as what they are not."""
    described = TURBINE.with_shear(not sheared)
    inference = inference_with_open("tube_shear", open_too, turbine=described)
    truth = truth_of(5)
    truth = replace(truth, description=replace(truth.description or averaged(), shear=sheared))
    found = refreshed(inference, truth, 5)
    name = f"tubes with{'' if sheared else 'out'} shear"
    assert name in found.best.alternative.name
    right = [each.weight for each in found.result.fitted if name in each.alternative.name]
    assert sum(right) > 0.999
    draws = np.log(found.draws[:, :3] * NOMINAL)
    assert np.abs((draws.mean(axis=0) - np.log(truth.theta)) / draws.std(axis=0)).max() < 3


def test_a_structure_that_has_lost_costs_one_descent_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the next refresh, where another structure holds: no search for other valleys."""
    inference = inference_with_open("tube_shear")
    first = refreshed(inference, truth_of(0), 0)
    lost = {each.name for each in first.warm_starts if each.lost}
    assert any("shear" in name for name in lost)
    descents: list[bool] = []
    descend = JointFit._cheapest_end  # type: ignore[attr-defined]

    def counted(
        self: JointFit, *arguments: Any, good_cost: float | None, sigma: float, **others: Any
    ) -> Any:
        descents.append(good_cost == np.inf and sigma == 0)  # not of the peak with a discrepancy
        return descend(self, *arguments, good_cost=good_cost, sigma=sigma, **others)

    monkeypatch.setattr(JointFit, "_cheapest_end", counted)
    rng = np.random.default_rng(8)
    second = joint_refresh(inference, first.evidence, first.warm_starts, rng)
    assert second is not None
    assert sum(descents) >= len(lost)
    again = {each.name for each in second.warm_starts if each.lost}
    assert {name for name in lost if "shear" in name} <= again <= lost
    assert second.best.alternative.name == first.best.alternative.name


def test_a_turned_sensor_is_named(one_structure_only: JointInference) -> None:
    found = refreshed(one_structure_only, truth_of(6), 6, (SensorFault("turned", 80.0, 15.0),))
    assert found.fault is not None
    assert "sensor at 80 m is turned by 1" in found.fault.text


@pytest.mark.nightly
def test_a_sensor_three_metres_off_is_named_where_no_descent_from_the_peak_leads_to_it(
    inference: JointInference,
) -> None:
    """Seed 208001: with its shapes a flooded tower whose tubes shear fits best, and badly; without
    them the description does."""
    far_off = (SensorFault("height", 80.0, 3.0),)
    case = structural_uncertainty.Case("3 m higher", 208001, faults=far_off)
    found = structural_uncertainty.outcome(case, "published", inference)
    assert found is not None
    assert any("the sensor at 80 m sits +2.9 m off" in doubt for doubt in found.doubts)
    assert all(found.held)


@pytest.mark.nightly
def test_a_sensor_that_no_fault_of_its_explains_is_left_out(dry_bending: JointInference) -> None:
    """Turned by 40° and four metres off: neither alone explains it. The springs come from the
    others, with all refreshes that follow; a sensor that reads as it should again is used."""
    truth = truth_of(30)
    both = (SensorFault("turned", 80.0, 40.0), SensorFault("height", 80.0, 4.0))
    found = refreshed(dry_bending, truth, 30, both)
    assert found.fault is not None
    assert found.fault.name == "left out 80 m"
    assert [each.code for each in distrust(found, SETTINGS.guards)] == ["sensor"]
    draws = np.log(found.draws[:, :3] * NOMINAL / truth.theta)
    assert np.abs(draws.mean(axis=0) / draws.std(axis=0)).max() < 3.5
    rng = np.random.default_rng(30)
    used = evidence_of(truth, rng, both)
    again = joint_refresh(dry_bending, used, found.warm_starts, rng, last_fault=found.fault.name)
    assert again is not None
    assert again.fault is not None
    assert again.fault.name == found.fault.name
    right = evidence_of(truth, rng)
    mended = joint_refresh(dry_bending, right, found.warm_starts, rng, last_fault=found.fault.name)
    assert mended is not None
    assert mended.fault is None


@pytest.mark.parametrize(
    ("known", "seed", "angle"),
    [
        ("one_structure_only", 27, 55),
        *(
            pytest.param("dry_bending", seed, each, marks=pytest.mark.nightly)
            for seed, each in [(27, 55), (28, 12), (29, 90)]
        ),
    ],
)
def test_sensors_that_are_all_turned_alike_are_named_and_read_so(
    request: pytest.FixtureRequest,
    known: str,
    seed: int,
    angle: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As under a nacelle whose yaw nothing reports. Beyond 40° modes have no right partners; the
    springs hold all the same. The next refresh goes by the angle that is known."""
    inference = request.getfixturevalue(known)
    heights = sorted({channel.elevation for channel in LAYOUT.channels})
    truth = truth_of(seed)
    found = refreshed(
        inference, truth, seed, tuple(SensorFault("turned", z, float(angle)) for z in heights)
    )
    assert found.fault is not None
    assert found.fault.name == ALL_TURNED
    assert found.fault.size(found.best.peak.u) * HEADING_STD == pytest.approx(angle, abs=3)
    assert found.best.peak.comparison.unlike_share < 0.12  # as of towers with right sensors
    assert [each.code for each in distrust(found, SETTINGS.guards)] == ["sensor"]
    draws = np.log(found.draws[:, :3] * NOMINAL / truth.theta)
    assert np.abs(draws.mean(axis=0) / draws.std(axis=0)).max() < 3.5
    monkeypatch.setattr(refresh, "likely_angles", lambda *_: pytest.fail("searched again"))
    rng = np.random.default_rng(seed)
    again = joint_refresh(
        inference, found.evidence, found.warm_starts, rng, last_fault=found.fault.name
    )
    assert again is not None
    assert again.fault is not None
    assert again.fault.text == found.fault.text


@pytest.mark.nightly
def test_a_posterior_by_frequencies_alone_is_not_trusted_where_shapes_are_others() -> None:
    """Headings that are stated to be exact, and are 30° off: nothing may explain the shapes."""
    stated = (("sensor_heading", 0.0), ("flooding", 0.0), ("tube_shear", 0.0))
    exact = replace(SETTINGS, structure=replace(UNCERTAIN, stds=stated))
    inference = joint_inference(TURBINE, LAYOUT, exact, seed=1)
    assert inference is not None
    heights = sorted({channel.elevation for channel in LAYOUT.channels})
    found = refreshed(
        inference, truth_of(26), 26, tuple(SensorFault("turned", z, 30.0) for z in heights)
    )
    assert found.fault is None
    assert "shapes-unlike" in [each.code for each in distrust(found, SETTINGS.guards)]


@pytest.mark.parametrize(
    ("known", "seed", "pair"),
    [
        ("one_structure_only", 21, (0, 1)),
        pytest.param("dry_bending", 21, (0, 1), marks=pytest.mark.nightly),
        pytest.param("dry_bending", 22, (2, 4), marks=pytest.mark.nightly),
    ],
)
def test_two_channels_exchanged_from_the_start_are_named(
    request: pytest.FixtureRequest,
    known: str,
    seed: int,
    pair: tuple[int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Along one direction modes keep their partners; across, most lose them. The next refresh
    goes by the fault that is known."""
    inference = request.getfixturevalue(known)
    one, other = pair
    channels = list(LAYOUT.channels)
    names = [channels[one].name, channels[other].name]
    channels[one] = replace(LAYOUT.channels[other], name=names[0])
    channels[other] = replace(LAYOUT.channels[one], name=names[1])
    exchanged = replace(LAYOUT, channels=tuple(channels))
    truth, rng = truth_of(seed), np.random.default_rng(seed)
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for estimate in estimates(truth, 3, rng, layout=exchanged, reported_levels=[0.0] * 3):
        evidence = evidence.with_estimate(estimate)
    found = joint_refresh(inference, evidence, (), rng)
    assert found is not None
    assert found.fault is not None
    assert found.fault.text == f"channels {names[0]} and {names[1]} are exchanged"
    assert found.refusal is None
    draws = np.log(found.draws[:, :3] * NOMINAL / truth.theta)
    assert np.abs(draws.mean(axis=0) / draws.std(axis=0)).max() < 3.5
    for search in ("sensor_fault", "likely_wirings"):
        monkeypatch.setattr(refresh, search, lambda *_, **__: pytest.fail("searched again"))
    again = joint_refresh(inference, evidence, found.warm_starts, rng, last_fault=found.fault.name)
    assert again is not None
    assert again.fault is not None
    assert again.fault.text == found.fault.text


def test_the_budget_names_what_makes_the_interval(one_structure: JointRefresh) -> None:
    budget = one_structure.budget
    np.testing.assert_allclose(budget.shares.sum(axis=0), 1.0, rtol=1e-9)
    largest = budget.names[int(np.argmax(budget.shares[:, 1]))]
    assert largest in ("added_mass", "water_level", "transition_piece")


def test_what_errors_of_the_figures_make_of_the_springs_is_part_of_their_variance(
    one_structure: JointRefresh,
) -> None:
    found = one_structure
    fit, covariance = found.best.fit, found.best.posterior.covariance
    errors = figure_errors(found.best.peak.u, covariance, fit.coordinates)
    stds = np.log(found.draws[:, :3]).std(axis=0)
    shares = (errors**2).sum(axis=0) / stds**2
    assert np.all((shares > 0.1) & (shares < 1.0))
    names = [*(figure.name for figure in fit.coordinates.figures), "water_level"]
    assert names[int(np.argmax(np.abs(errors[:, 1])))] in ("added_mass", "water_level")


def test_modes_of_the_right_structure_predict_each_other(one_structure: JointRefresh) -> None:
    checks = one_structure.checks
    assert checks.unpredicted_share < 0.1
    assert np.std(checks.frequency_misfits) < 1.6


def test_the_updater_publishes_the_joint_posterior_and_goes_on_after_a_restart(
    dry_bending: JointInference,
) -> None:
    updater = FoundationUpdater(
        ModalModel(TURBINE, LAYOUT), LAYOUT, SETTINGS, seed=1, joint=dry_bending
    )
    windows = estimates(truth_of(7), 2, np.random.default_rng(7), reported_levels=[0.1, 0.4])
    state, first = updater.updated(updater.initial_state(), windows[0])
    assert isinstance(first, FoundationPosterior)
    assert first.structure == "uncertain"
    assert first.budget
    sent = decode(FoundationPosterior, encode(first))
    assert sent.alternatives == first.alternatives
    assert sent.figure_errors == first.figure_errors != ()
    _, second = updater.updated(state, windows[1])
    _, again = updater.updated(updater.restored(updater.saved(state)), windows[1])
    assert isinstance(second, FoundationPosterior)
    assert isinstance(again, FoundationPosterior)
    np.testing.assert_array_equal(again.draws, second.draws)


@pytest.mark.nightly
def test_each_window_has_a_level_of_its_own_where_nothing_reports_it(
    dry_bending: JointInference,
) -> None:
    """Half a tide of 2.4 m: levels follow from the modes, counted from the first window's, and the
    last posterior takes them out again: its modes are those of the first window's water."""
    truth, hours = truth_of(11), np.arange(24) / 6
    tide = 1.2 * np.sin(2 * np.pi * hours / 12.42)
    windows = estimates(truth, 24, np.random.default_rng(11), levels=tide.round(1).tolist())
    updater = FoundationUpdater(
        ModalModel(TURBINE, LAYOUT), LAYOUT, SETTINGS, seed=1, joint=dry_bending
    )
    state = updater.initial_state()
    for number, window in enumerate(windows):
        if number in (0, 3):
            state, _ = updater.updated(state, window)
        else:
            state, event = updater.accumulated(state, window)
            assert event is None
    rises = np.array([window.rise for window in state.recent])
    assert np.sqrt(np.mean((rises - tide)[4:] ** 2)) < 0.15
    warm = state.joint[0]
    fit = dry_bending.fit_of(warm.name)
    still = at_model_level(state.evidence, fit, warm.u)
    first = {mode.track: mode.frequency for mode in updater_evidence(windows[0]).modes}
    apart = [mode.frequency / first[mode.track] - 1 for mode in still.modes if mode.track in first]
    wet = [
        mode.frequency / first[mode.track] - 1
        for mode in state.evidence.modes
        if mode.track in first
    ]
    assert np.median(np.abs(apart)) < 0.6 * np.median(np.abs(wet))


def updater_evidence(estimate: ModalEstimate) -> ModalEvidence:
    return ModalEvidence(channels=LAYOUT.channel_names).with_estimate(estimate)


def test_errors_of_the_structure_cancel_in_springs_relative_to_a_reference(
    dry_bending: JointInference,
) -> None:
    before = truth_of(10)
    after = replace(before, theta=before.theta * np.array([1.0, 0.9, 1.0]))
    evidence = []
    for number, truth in enumerate((before, after)):
        rng = np.random.default_rng([10, number])
        seen = ModalEvidence(channels=LAYOUT.channel_names)
        for estimate in estimates(truth, 3, rng, reported_levels=[0.0] * 3):
            seen = seen.with_estimate(estimate)
        evidence.append(seen)
    fit = dry_bending.fits[0][1]
    peak = fit.best(evidence[1])
    assert peak is not None
    found = relative_springs(fit, *evidence, peak.u)
    assert found is not None
    stds = np.sqrt(np.diag(found.covariance))
    assert stds[1] < 0.04
    assert abs(found.mean[1] - np.log(0.9)) < 3 * stds[1]


@pytest.mark.nightly
def test_the_errors_of_a_description_that_does_not_hold_cancel_too(
    dry_bending: JointInference,
) -> None:
    """Blades with twist and their own distribution: the springs are off by a factor, their change
    is not. As after a first refresh, which looked for faults of sensors in vain."""
    factor = np.array([0.85, 0.85, 0.85])
    before = Truth(theta=NOMINAL, description=detailed())
    after = replace(before, theta=factor * NOMINAL)
    evidence = []
    for number, truth in enumerate((before, after)):
        seen = ModalEvidence(channels=LAYOUT.channel_names)
        rng = np.random.default_rng([12, number])
        for estimate in estimates(truth, 4, rng, reported_levels=[0.0] * 4):
            seen = seen.with_estimate(estimate)
        evidence.append(seen)
    generator = np.random.default_rng(12)
    found = joint_refresh(
        dry_bending, evidence[1], (), generator, reference=evidence[0], searched_windows=4
    )
    assert found is not None
    assert found.best.fit.is_rough
    assert found.relative is not None
    stds = np.sqrt(np.diag(found.relative.covariance))
    assert stds.max() < 0.15
    assert np.abs((found.relative.mean - np.log(factor)) / stds).max() < 2.5


def test_a_rough_description_gives_a_wide_interval_and_says_so(
    dry_bending: JointInference, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every frequency off by up to a percent and more, as by no figure: an answer, no refusal,
    blades of one mesh, and no second search for a sensor's fault before there is a quarter more to
    judge by."""
    truth, rng = truth_of(9), np.random.default_rng(9)
    off: dict[int, float] = {}
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for estimate in estimates(truth, 3, rng, layout=LAYOUT, reported_levels=[0.0] * 3):
        modes = []
        for mode in estimate.modes:
            key = round(20 * np.log(mode.frequency))
            factor = off.setdefault(key, 1 + rng.choice([-1, 1]) * rng.uniform(0.008, 0.015))
            modes.append(replace(mode, frequency=mode.frequency * factor))
        evidence = evidence.with_estimate(replace(estimate, modes=tuple(modes)))
    inference = dry_bending.with_fits(shortly)
    found = joint_refresh(inference, evidence, (), rng)
    assert found is not None
    assert found.refusal is None
    assert found.best.fit.is_rough
    assert len(found.result.fitted) == 1
    assert found.fault is None
    codes = [each.code for each in distrust(found, SETTINGS.guards)]
    assert "description-off" in codes
    low, high = np.quantile(found.draws[:, :3] * NOMINAL / truth.theta, [0.05, 0.95], axis=0)
    assert np.all((low < 1) & (high > 1))
    assert np.all(high / low > 1.3)

    assert found.searched_windows == evidence.n_windows
    for search in ("sensor_fault", "likely_wirings"):
        monkeypatch.setattr(refresh, search, lambda *_, **__: pytest.fail("searched again"))
    again = joint_refresh(
        inference, evidence, found.warm_starts, rng, searched_windows=found.searched_windows
    )
    assert again is not None
    assert again.searched_windows == found.searched_windows


@pytest.mark.nightly
def test_swapped_sensors_are_named_whatever_structure_fitted_their_shapes_best(
    inference: JointInference,
) -> None:
    """Seed 172107: with the wrong shapes the described blades fitted best; with the right ones
    only the converged ones do."""
    swapped = next(
        c for c in structural_uncertainty.cases("sensors", 172000, 8) if c.seed == 172107
    )
    found = structural_uncertainty.outcome(swapped, "published", inference)
    assert found is not None
    assert any("80 m and 145 m are swapped" in doubt for doubt in found.doubts)
    assert all(found.held)


@pytest.mark.nightly
def test_the_change_is_told_with_the_reference_read_as_the_latest_windows_are(
    dry_bending: JointInference,
) -> None:
    """Two sensors have been exchanged from the start, the springs are those of the reference."""
    truth, swapped = truth_of(31), (SensorFault("swapped", 80.0, 145.0),)
    reference = evidence_of(truth, np.random.default_rng(31), swapped)
    rng = np.random.default_rng(32)
    found = joint_refresh(
        dry_bending, evidence_of(truth, rng, swapped), (), rng, reference=reference
    )
    assert found is not None
    assert found.fault is not None
    assert found.fault.name == "swapped 80 145"
    assert found.relative is not None
    stds = np.sqrt(np.diag(found.relative.covariance))
    assert np.abs(found.relative.mean / stds).max() < 3
    assert stds.max() < 0.03  # frequencies alone tell it to .04
