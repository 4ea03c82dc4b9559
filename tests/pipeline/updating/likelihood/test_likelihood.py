"""The likelihood against its own formula written out, and against the windows taken one by one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest, multivariate_normal

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import mode_observations
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    ModeComparison,
    observations,
    sigma_grid,
)
from pipeline.updating.likelihood.pairing import Pairing
from pipeline.updating.prior import UpdatingError
from tests.pipeline.updating.small_tower import LAYOUT, NOMINAL, LinearTower, drawn_estimate

TRUTH = np.array([1.05, 0.97, 1.02])
TOWER = LinearTower()
NO_FLOOR = LikelihoodSettings(
    frequency_floor=0.0, shape_floor=0.0, sigma_points=200, tails="gaussian"
)


def evidence_of(n_windows, *, seed, **options):
    generator = np.random.default_rng(seed)
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    estimates = [
        drawn_estimate(TRUTH, generator, window=number, tower=TOWER, **options)
        for number in range(n_windows)
    ]
    for estimate in estimates:
        evidence = evidence.with_estimate(estimate)
    return evidence, estimates


def likelihood_of(evidence, settings=NO_FLOOR, **used):
    options = {"shape_used": True, "gap": 0.0, **used}
    every = [ModeComparison(number, (number,), **options) for number in range(len(evidence.modes))]
    return ModalLikelihood(
        evidence,
        every,
        model_columns=range(len(every)),
        settings=settings,
        highest_sigma=0.1,
    )


def near_truth(n, *, seed):
    ratios = TRUTH + 0.01 * np.random.default_rng(seed).standard_normal((n, 3))
    return TOWER.modal(ratios * NOMINAL)


def test_all_windows_at_once_equal_their_joint_gaussian_with_one_shared_discrepancy():
    """η_t = b + e_t, b ~ N(0, σ² R) once for all windows: the T·p-dimensional normal."""
    n_windows, sigma_index = 4, 120
    evidence, estimates = evidence_of(n_windows, seed=1)
    likelihood = likelihood_of(evidence)
    modes = near_truth(5, seed=2)
    collapsed = likelihood.log_likelihood(modes)[:, sigma_index]
    errors, own = [], []
    for estimate in estimates:
        window = ModalEvidence(channels=LAYOUT.channel_names)
        frozen = [
            replace(m, information=0 * m.information, information_mean=0 * m.mean)
            for m in evidence.modes
        ]
        window = replace(window, modes=tuple(frozen))
        one = likelihood_of(_with_observations(window, estimate))
        errors.append(one.errors(modes))
        own.append(one.measurement_covariance)
    shared = np.diag(likelihood.sigma[sigma_index] ** 2 * likelihood.reference)
    joint = np.kron(np.ones((n_windows, n_windows)), shared)
    p = len(shared)
    for number, covariance in enumerate(own):
        joint[number * p : (number + 1) * p, number * p : (number + 1) * p] += covariance
    brute = multivariate_normal(np.zeros(len(joint)), joint).logpdf(np.hstack(errors))
    assert collapsed - collapsed[0] == pytest.approx(brute - brute[0], abs=1e-6)


def _with_observations(window, estimate):
    """One window's own evidence, its unit components those of the combined evidence."""
    modes = [
        mode.with_observation(observation, window=0, weight=1.0, joint_covariance=False)
        for mode, observation in zip(
            window.modes, mode_observations(estimate, LAYOUT.channel_names), strict=True
        )
    ]
    return replace(window, modes=tuple(modes), n_windows=1)


def test_the_ratio_of_two_sigmas_also_agrees_with_the_normal_density():
    evidence, _ = evidence_of(1, seed=3)
    likelihood = likelihood_of(evidence)
    modes = near_truth(1, seed=4)
    errors = likelihood.errors(modes)[0]
    values = likelihood.log_likelihood(modes)[0]
    for index in (0, 60, 150):
        sigma = likelihood.sigma[index]
        covariance = likelihood.measurement_covariance + np.diag(sigma**2 * likelihood.reference)
        brute = multivariate_normal(np.zeros(len(errors)), covariance).logpdf(errors)
        base = multivariate_normal(np.zeros(len(errors)), likelihood.measurement_covariance).logpdf(
            errors
        )
        assert values[index] - values[0] == pytest.approx(brute - base, abs=1e-6)


def test_sigma_is_the_relative_error_of_slow_and_fast_frequencies_alike():
    """Each frequency of the model 1 % off: each mode by itself says σ = .01."""
    evidence, _ = evidence_of(1, seed=3)
    for mode in (evidence.modes[0], evidence.modes[-1]):
        likelihood = likelihood_of(replace(evidence, modes=(mode,)), shape_used=False)
        model = near_truth(1, seed=4)
        off = replace(
            model, frequencies=np.array([[1.01 * mode.frequency]]), shapes=model.shapes[:, :1]
        )
        likeliest = likelihood.sigma[np.argmax(likelihood.log_likelihood(off)[0])]
        assert likeliest == pytest.approx(0.01, rel=0.05)


def test_a_joint_covariance_is_used_whole():
    generator = np.random.default_rng(5)
    estimate = drawn_estimate(TRUTH, generator, tower=TOWER)
    modes = []
    for mode in estimate.modes:
        mixing = np.eye(len(mode.covariance_factor))
        mixing[3:, 0] = 0.3 / mode.frequency  # shape errors that go with those of f
        factor = mixing @ mode.covariance_factor
        factor[2 + mode.unit_component] = 0.0
        modes.append(replace(mode, covariance_factor=factor))
    evidence = ModalEvidence(channels=LAYOUT.channel_names, joint_covariance=True)
    evidence = evidence.with_estimate(replace(estimate, modes=tuple(modes)))
    combined = evidence.modes[2]
    known = np.flatnonzero(combined.known)
    expected = modes[2].covariance[np.ix_([0, *(known[1:] + 1)], [0, *(known[1:] + 1)])]
    assert combined.covariance[np.ix_(known, known)] == pytest.approx(expected, rel=1e-6)
    assert np.isfinite(likelihood_of(evidence).log_likelihood(near_truth(1, seed=6))).all()


def test_sigma_integrated_on_the_grid_equals_its_quadrature():
    evidence, _ = evidence_of(2, seed=7)
    likelihood = likelihood_of(evidence)
    modes = near_truth(1, seed=8)
    errors = likelihood.errors(modes)[0]

    def density(sigma):
        covariance = likelihood.measurement_covariance + np.diag(sigma**2 * likelihood.reference)
        _, determinant = np.linalg.slogdet(covariance)
        return np.exp(-0.5 * (errors @ np.linalg.solve(covariance, errors) + determinant) - offset)

    offset = 0.0
    _, base = np.linalg.slogdet(likelihood.measurement_covariance)
    offset = -0.5 * (errors @ np.linalg.solve(likelihood.measurement_covariance, errors) + base)
    brute = quad(density, 0, 0.1, points=[0.001, 0.003, 0.01], epsrel=1e-8)[0] / 0.1
    marginal, _ = likelihood.marginal(modes, np.random.default_rng(0))
    at_zero = likelihood.log_likelihood(modes)[0, 0]
    assert marginal[0] - at_zero == pytest.approx(np.log(brute), abs=2e-3)


def test_sigmas_drawn_for_one_stiffness_follow_their_conditional_density():
    evidence, _ = evidence_of(2, seed=9)
    likelihood = likelihood_of(evidence)
    ratios = np.repeat((TRUTH * [1.02, 1, 1])[None], 4000, axis=0)
    modes = TOWER.modal(ratios * NOMINAL)
    _, drawn = likelihood.marginal(modes, np.random.default_rng(10))
    values = likelihood.log_likelihood(TOWER.modal(ratios[:1] * NOMINAL))[0]
    density = np.exp(values - values.max())
    steps = (density[1:] + density[:-1]) / 2 * np.diff(likelihood.sigma)
    cumulated = np.append(0.0, np.cumsum(steps)) / steps.sum()
    assert kstest(drawn, lambda x: np.interp(x, likelihood.sigma, cumulated)).pvalue > 0.01


def test_the_grid_of_sigma_carries_the_uniform_prior():
    sigma, weights = sigma_grid(0.1, 200)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights * sigma).sum() == pytest.approx(0.05, rel=1e-3)


def test_the_inverse_covariance_sharpens_with_better_data_where_the_printed_one_would_not():
    """Eq. 9 as printed, ηᵀ Σ η, falls with smaller Σ: better data would say less."""
    blunt, _ = evidence_of(1, seed=11, frequency_std=0.002)
    sharp, _ = evidence_of(1, seed=11, frequency_std=0.0005)
    away = TOWER.modal((TRUTH * 1.05 * NOMINAL)[None])
    drops = [
        np.ptp(likelihood_of(each).log_likelihood(_joined(away))[:, 0]) for each in (blunt, sharp)
    ]
    assert drops[1] > 4 * drops[0]


def _joined(away):
    truth = TOWER.modal((TRUTH * NOMINAL)[None])
    return replace(
        truth,
        frequencies=np.vstack([truth.frequencies, away.frequencies]),
        shapes=np.vstack([truth.shapes, truth.shapes]),
    )


def test_a_floor_stays_however_many_windows_are_combined():
    settings = LikelihoodSettings(frequency_floor=0.001, shape_floor=0.01)
    evidence, _ = evidence_of(50, seed=12)
    likelihood = likelihood_of(evidence, settings)
    rows = likelihood.frequency_components
    stds = np.sqrt(np.diag(likelihood.measurement_covariance))[rows]
    frequencies = [mode.frequency for mode in evidence.modes]
    expected = np.hypot(0.001, 0.001 / np.sqrt(50))
    assert stds / frequencies == pytest.approx(expected, rel=0.01)


def test_a_stiffness_without_modes_has_no_likelihood():
    evidence, _ = evidence_of(1, seed=13)
    modes = near_truth(2, seed=14)
    modes.frequencies[1] = np.nan
    values = likelihood_of(evidence).log_likelihood(modes)
    assert np.isfinite(values[0]).all()
    assert np.all(values[1] == -np.inf)


def pairing_of(model_modes):
    return Pairing(np.ones(3), model_modes, total_cost=0.0, cost=0.0, paired_share=1.0)


@pytest.mark.parametrize(
    ("gap", "shape_used", "added"), [(0.002, False, 0.002), (0.01, False, 0.0), (0.05, True, 0.0)]
)
def test_a_neighbour_takes_the_shape_or_widens_the_frequency(gap, shape_used, added):
    """T = 600 s: 1.5/T = .0025 Hz; 1.2 % of 1.7 Hz = .02 Hz."""
    evidence, _ = evidence_of(1, seed=15)
    model = np.array([mode.frequency for mode in evidence.modes] + [evidence.modes[0].frequency])
    model[-1] += gap
    found = observations(evidence, pairing_of((0, -1, -1, -1, -1, -1)), model, NO_FLOOR)
    assert len(found) == 1
    assert found[0].shape_used is shape_used
    assert found[0].gap == pytest.approx(added)


@pytest.mark.parametrize(
    ("gap", "mac", "shape_used"), [(0.01, 0.4, True), (0.01, 0.6, False), (0.005, 0.1, False)]
)
def test_a_neighbour_of_another_shape_takes_the_shape_only_where_it_is_nearer(gap, mac, shape_used):
    """.6 % of 1.7 Hz is nearer than like shapes may be, not than unlike ones, .4 %."""
    evidence, _ = evidence_of(1, seed=15)
    model = np.array([mode.frequency for mode in evidence.modes] + [evidence.modes[0].frequency])
    model[-1] += gap
    macs = np.append(np.where(np.arange(6)[:, None] == np.arange(6), 0.999, 0.1), [[mac]] * 6, 1)
    (found,) = observations(evidence, pairing_of((0, *[-1] * 5)), model, NO_FLOOR, mac=macs)
    assert found.shape_used is shape_used
    assert not found.shape_unlike


def test_a_shape_that_is_not_its_partners_leaves_the_frequency_alone():
    """A mixture of two modes, of MAC .93, would be bought off by a σ that blurs all the others."""
    evidence, _ = evidence_of(1, seed=15)
    model = np.array([mode.frequency for mode in evidence.modes])
    mac = np.where(np.arange(6)[:, None] == np.arange(6), 0.999, 0.1)
    mac[2, 2] = 0.93
    found = observations(evidence, pairing_of(tuple(range(6))), model, NO_FLOOR, mac=mac)
    assert [each.shape_used for each in found] == [True, True, False, True, True, True]
    assert [each.gap for each in found] == [0.0] * 6


@pytest.mark.parametrize(("gap", "both"), [(0.0006, True), (0.004, True), (0.006, False)])
def test_a_close_pair_is_compared_by_its_mean_with_the_mean_of_the_two(gap: float, both: bool):
    """The identification takes poles up to .5 % apart for one pair, more than a window resolves."""
    evidence, _ = evidence_of(1, seed=16)
    pair = replace(evidence.modes[0], close_pair=True)
    evidence = replace(evidence, modes=(pair, *evidence.modes[1:]))
    beside = pair.frequency * (1 + gap)
    model = np.array([mode.frequency for mode in evidence.modes] + [beside])
    (found,) = observations(evidence, pairing_of((0, -1, -1, -1, -1, -1)), model, NO_FLOOR)
    assert found.model_modes == ((0, 6) if both else (0,))
    assert not found.shape_used


def test_settings_that_are_negative_are_refused_with_their_value():
    with pytest.raises(UpdatingError, match=r"-0\.1"):
        LikelihoodSettings(frequency_floor=-0.1)


def test_a_neighbour_that_may_be_meant_is_one_more_standard_deviation_of_the_frequency():
    """Independent errors add in quadrature: the estimate's, the floor, the neighbour's distance."""
    evidence, _ = evidence_of(3, seed=31)
    gap, settings = 0.02, LikelihoodSettings()
    alone = likelihood_of(evidence, settings)
    beside = likelihood_of(evidence, settings, gap=gap)
    rows = alone.frequency_components
    added = np.diag(beside.measurement_covariance - alone.measurement_covariance)
    assert added[rows] == pytest.approx(gap**2)
    assert np.delete(added, rows) == pytest.approx(0.0)
    floor = settings.frequency_floor * np.array([mode.frequency for mode in evidence.modes])
    own = np.array([mode.frequency_std for mode in evidence.modes])
    variances = np.diag(beside.measurement_covariance)[rows]
    assert variances == pytest.approx(own**2 + floor**2 + gap**2)


def test_however_many_windows_agree_a_frequency_is_never_known_better_than_its_floor():
    """Identification has a small persistent bias that windows do not average out. On independent
    data it is .10 to .18 % for single modes and below .05 % for most, so that less than .04 %
    would claim more than was found, and more than .06 % would throw information away."""
    evidence, _ = evidence_of(400, seed=32, frequency_std=0.001)
    likelihood = likelihood_of(evidence, LikelihoodSettings())
    frequencies = np.array([mode.frequency for mode in evidence.modes])
    variances = np.diag(likelihood.measurement_covariance)[likelihood.frequency_components]
    shares = np.sqrt(variances) / frequencies
    assert np.all((shares > 0.0004) & (shares < 0.0006))
