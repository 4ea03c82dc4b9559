"""Modal estimates in, a posterior out that holds the truth as often as it says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from pipeline.messages import FoundationEvent, FoundationPosterior, WindowRejected
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.importance import ImportanceSettings
from pipeline.updating.samplers.interface import Peak, PosteriorDraws, Target
from pipeline.updating.samplers.registry import SamplingSettings, sampler_of
from pipeline.updating.samplers.tmcmc import TemperingSettings
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.updater import FoundationUpdater, _joint_sensitivities
from tests.pipeline.updating.likelihood.test_likelihood import evidence_of, likelihood_of
from tests.pipeline.updating.small_tower import (
    LAYOUT,
    NOMINAL,
    LinearTower,
    SmallTower,
    drawn_estimate,
    drawn_mode,
)

TRUTH = np.array([1.1, 0.9, 0.95])
NAMES = ("k11", "k22", "k12")
QUICK = UpdatingSettings(
    pairing=PairingSettings(search_draws=200, tried=6, refined=2),
    likelihood=LikelihoodSettings(frequency_floor=0.0, shape_floor=0.0, sigma_points=40),
    sampling=SamplingSettings(
        importance=ImportanceSettings(effective_draws=300, pilot=100, draws=2000)
    ),
    sampler=SamplerSettings(
        walkers=20, burn_in=12, block=15, effective_draws=300, chain_in_autocorrelation_times=15
    ),
)


@pytest.fixture(scope="module")
def updater():
    return FoundationUpdater(SmallTower(), LAYOUT, QUICK, seed=1)


def after(updater, estimates, state=None):
    """State and answers after some windows."""
    state, answers = state or updater.initial_state(), []
    for estimate in estimates:
        state, answer = updater.updated(state, estimate)
        answers.append(answer)
    return state, answers


def of_all(updater, estimates):
    """The posterior of some windows at once."""
    *before, last = estimates
    state = updater.initial_state()
    for estimate in before:
        state = replace(state, evidence=state.evidence.with_estimate(estimate))
    return updater.updated(state, last)[1]


def windows(n, *, seed, first=0, **options):
    generator = np.random.default_rng(seed)
    return [drawn_estimate(TRUTH, generator, window=first + i, **options) for i in range(n)]


@pytest.fixture(scope="module")
def three_windows(updater):
    return after(updater, windows(3, seed=1))


@pytest.mark.parametrize(
    ("seeds", "fewest"),
    [
        pytest.param(range(20), 14, id="day"),
        pytest.param(range(40), 31, id="night", marks=pytest.mark.nightly),
    ],
)
def test_posterior_covers_the_true_stiffness_at_the_stated_rate(seeds, fewest):
    """Truths all over .8 to 1.25, four windows that share a .3 % model discrepancy."""
    updater = FoundationUpdater(LinearTower(), LAYOUT, QUICK, seed=2)
    covered = []
    for seed in seeds:
        generator = np.random.default_rng([3, seed])
        truth = generator.uniform(0.8, 1.25, 3)
        bias = 0.003 * generator.standard_normal(6)
        posterior = of_all(
            updater,
            [
                drawn_estimate(truth, generator, window=number, tower=LinearTower(), bias=bias)
                for number in range(4)
            ],
        )
        assert isinstance(posterior, FoundationPosterior)
        summaries = [posterior.parameter(name) for name in NAMES]
        ratios = truth * NOMINAL
        covered.append([s.p05 <= k <= s.p95 for s, k in zip(summaries, ratios, strict=True)])
    # binomial: 90 % of 40 is 36, below 31 once in 200; of 20 18, below 14 once in 400
    assert np.sum(covered, axis=0).min() >= fewest


def test_every_window_narrows_the_interval(three_windows):
    _, posteriors = three_windows
    for name in NAMES:
        widths = [p.parameter(name).p95 - p.parameter(name).p05 for p in posteriors]
        assert widths[2] < 0.8 * widths[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_two_modes_leave_a_ridge_that_contradicts_nothing_and_says_so(updater, seed):
    """Beside a long ridge the medians of the springs, each for itself, would fit nothing."""
    few = [replace(each, modes=each.modes[:2]) for each in windows(3, seed=seed)]
    posterior = of_all(updater, few)
    assert posterior.trusted
    assert posterior.reduced_chi_square < 1
    assert "not-identified" in [warning.code for warning in posterior.warnings]
    for name, k in zip(NAMES, TRUTH * NOMINAL, strict=True):
        assert posterior.parameter(name).p05 <= k <= posterior.parameter(name).p95


def test_the_truth_lies_within_the_posterior(three_windows):
    _, posteriors = three_windows
    parameters = [posteriors[-1].parameter(name) for name in NAMES]
    for parameter, truth in zip(parameters, TRUTH * NOMINAL, strict=True):
        std = (parameter.p95 - parameter.p05) / 3.29
        assert abs(parameter.median - truth) < 4 * std


def test_every_field_of_the_message_is_filled(three_windows):
    _, posteriors = three_windows
    posterior = posteriors[-1]
    assert posterior.n_windows == 3
    assert posterior.window == 2
    assert posterior.time_ns == 1_800_000_000_000
    assert [each.name for each in posterior.parameters] == [*NAMES, "sigma"]
    assert posterior.draws.shape == (1000, 4)
    assert posterior.correlation == pytest.approx(posterior.correlation.T)
    assert len(posterior.model_labels) == len(posterior.model_frequencies) == 12
    assert np.abs(posterior.model_shapes).max(axis=1) == pytest.approx(1.0)
    assert len(posterior.pairs) == 12
    assert min(pair.mac for pair in posterior.pairs if pair.shape_used) > 0.98
    assert posterior.trusted
    assert posterior.rhat < 1.15  # chains of fifteen autocorrelation times
    assert posterior.ess > 300
    assert 0.2 < posterior.reduced_chi_square < 3


def test_the_thinned_draws_have_the_medians_of_the_chains(three_windows):
    _, posteriors = three_windows
    posterior = posteriors[-1]
    for column, parameter in enumerate(posterior.parameters):
        width = parameter.p95 - parameter.p05
        median = np.median(posterior.draws[:, column])
        assert abs(median - parameter.median) < 0.1 * width


def test_the_same_windows_give_the_same_posterior_to_the_last_bit(updater, three_windows):
    _, again = after(updater, windows(3, seed=1))
    for one, other in zip(three_windows[1], again, strict=True):
        assert np.array_equal(one.draws, other.draws)
        assert one.parameters == other.parameters


def test_yesterdays_posterior_is_never_todays_prior(updater, three_windows):
    """Without the last ensemble and median the same evidence gives the same posterior."""
    state, _ = after(updater, windows(2, seed=1))
    cold = replace(state, ensemble=None, median=None)
    estimate = windows(3, seed=1)[2]
    warm_posterior, cold_posterior = (updater.updated(each, estimate)[1] for each in (state, cold))
    for name in NAMES:
        warm, fresh = warm_posterior.parameter(name), cold_posterior.parameter(name)
        width = fresh.p95 - fresh.p05
        assert abs(warm.median - fresh.median) < 0.1 * width
        assert warm.p95 - warm.p05 == pytest.approx(width, rel=0.2)


def test_windows_at_high_water_say_what_they_would_have_said_at_the_models_level():
    tower = LinearTower(water=(-0.005, -0.0008))
    updater = FoundationUpdater(tower, LAYOUT, QUICK, seed=4)
    dry = windows(3, seed=13, tower=LinearTower())
    rises = (1.5, -0.5, 2.0)  # [m]
    wet = [at_level(each, rise, tower.water) for each, rise in zip(dry, rises, strict=True)]
    (_, ours), (_, expected) = after(updater, wet), after(updater, dry)
    for name in NAMES:
        risen, level = ours[-1].parameter(name), expected[-1].parameter(name)
        # 300 effective draws; without the water's curves it would be ten widths
        assert abs(risen.median - level.median) < 0.25 * (level.p95 - level.p05)


def at_level(estimate, rise, water):
    """The estimate with every frequency as the water moves it: ln f by a l + b l²."""
    times = np.exp(water[0] * rise + water[1] * rise**2)
    modes = [replace(mode, frequency=mode.frequency * times) for mode in estimate.modes]
    return replace(estimate, modes=tuple(modes), water_level=rise)


def test_an_estimate_without_a_partner_in_the_model_is_rejected_and_leaves_no_trace(
    updater, three_windows
):
    state, _ = three_windows
    generator = np.random.default_rng(5)
    noise = drawn_mode(0.8, generator.standard_normal(8), generator, 0.001, 0.01)
    estimate = replace(windows(1, seed=6, first=3)[0], modes=(noise,))
    unchanged, answer = updater.updated(state, estimate)
    assert isinstance(answer, WindowRejected)
    assert answer.code == "no-paired-mode"
    assert unchanged is state


def test_an_empty_estimate_is_rejected_before_anything_was_seen(updater):
    estimate = replace(windows(1, seed=7)[0], modes=())
    state, answer = updater.updated(updater.initial_state(), estimate)
    assert isinstance(answer, WindowRejected)
    assert answer.code == "no-modes"
    assert not state.evidence.modes


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_covariance_that_cannot_be_leaves_the_last_posterior_standing(
    updater, three_windows, value
):
    state, _ = three_windows
    estimate = windows(1, seed=12, first=3)[0]
    factor = estimate.modes[1].covariance_factor.copy()
    factor[0] = value
    broken = replace(estimate.modes[1], covariance_factor=factor)
    unchanged, answer = updater.updated(
        state, replace(estimate, modes=(estimate.modes[0], broken, *estimate.modes[2:]))
    )
    assert isinstance(answer, WindowRejected)
    assert answer.code == "covariance"
    assert f"{broken.frequency:.4g} Hz" in answer.reason
    assert unchanged is state


def test_a_structure_that_is_not_the_modelled_one_is_not_trusted(updater):
    _, (answer,) = after(updater, windows(1, seed=8, tower=SmallTower(stiffening=1.04)))
    assert isinstance(answer, FoundationPosterior)
    assert not answer.trusted
    assert {each.code for each in answer.warnings} & {"misfit", "few-pairs", "pairing-cost"}


def test_a_structure_of_which_no_mode_is_known_is_refused(updater):
    _, (answer,) = after(updater, windows(1, seed=8, tower=SmallTower(stiffening=1.4)))
    assert isinstance(answer, WindowRejected)


def test_one_mode_does_not_identify_three_springs_and_the_posterior_says_so(updater):
    _, answers = after(updater, windows(1, seed=9, labels=("5",), frequency_std=0.01))
    posterior = answers[0]
    assert isinstance(posterior, FoundationPosterior)
    assert any(
        each.code == "not-identified" and "interval" in each.text for each in posterior.warnings
    )


@pytest.mark.parametrize("method", ["emcee", "tmcmc", "importance"])
def test_every_sampler_agrees_with_a_grid_on_a_slice_of_two_stiffnesses(method):
    evidence, _ = evidence_of(1, seed=10, frequency_std=0.003, shape_std=0.03)
    slice_ = StiffnessSlice(likelihood_of(evidence))
    axes = [np.linspace(0.85, 1.25, 121), np.linspace(0.8, 1.15, 121)]
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    values = np.concatenate([slice_(part)[0] for part in np.array_split(mesh, 30)])
    weights = np.exp(values - logsumexp(values))
    mean = weights @ mesh
    std = np.sqrt(weights @ (mesh - mean) ** 2)
    assert weights.reshape(121, 121)[[0, -1]].sum() < 1e-6, "the grid must hold the posterior"
    sampling = SamplingSettings(
        method=method,
        importance=ImportanceSettings(effective_draws=3000),
        tempering=TemperingSettings(samples=8000, particles=500, pilot=1000),
    )
    sampler = sampler_of(sampling, SamplerSettings(effective_draws=3000))
    drawn = sampler(slice_.target(mean, np.diag(std**2)), np.random.default_rng(11))
    assert (drawn.flat[:, :2].mean(axis=0) - mean) / std == pytest.approx(0, abs=0.08)
    assert drawn.flat[:, :2].std(axis=0) / std == pytest.approx(1, abs=0.06)
    if method != "emcee":  # a chain says nothing of the evidence
        integral = logsumexp(values) + sum(np.log(axis[1] - axis[0]) for axis in axes)
        volume = 2 * np.log(BOX[1] - BOX[0])
        assert drawn.log_evidence == pytest.approx(integral - volume, abs=0.05)


BOX = (0.5, 1.5)  # of the slice's uniform prior


class StiffnessSlice:
    """Posterior of k11 and k22 at a k12 of 1.02 times nominal, σ integrated out."""

    def __init__(self, likelihood):
        self.likelihood = likelihood
        self.generator = np.random.default_rng(12)

    def __call__(self, pairs):
        ratios = np.column_stack([pairs, np.full(len(pairs), 1.02)])
        values, sigma = self.likelihood.marginal(
            LinearTower().modal(ratios * NOMINAL), self.generator
        )
        inside = ((pairs > BOX[0]) & (pairs < BOX[1])).all(axis=1)
        return np.where(inside, values, -np.inf), sigma

    def target(self, mean, covariance):
        return Target(
            log_density=self,
            prior_draws=lambda n, generator: generator.uniform(*BOX, size=(n, 2)),
            log_prior_volume=2 * np.log(BOX[1] - BOX[0]),
            peak=Peak(mean, covariance),
        )


def test_a_spring_that_softens_by_a_tenth_is_told_with_when_and_how_much():
    """Seven windows, then k22 a tenth softer: an event by the third. That the size is right over
    many streams is in test_half_way."""
    updater = FoundationUpdater(SmallTower(), LAYOUT, QUICK, seed=5)
    generator, state, events = np.random.default_rng(14), updater.initial_state(), []
    for number in range(10):
        ratios = TRUTH * (np.array([1.0, 0.9, 1.0]) if number >= 7 else 1.0)
        state, answers = updater.watched(state, drawn_estimate(ratios, generator, window=number))
        events += [each for each in answers if isinstance(each, FoundationEvent)]
        if events:
            break
    (event,) = events
    assert event.window <= 9
    assert event.kind == "foundation"
    assert event.since_ns == 7 * 600_000_000_000
    for each, truth in zip(event.changes, (0.0, -0.1, 0.0), strict=True):
        std = (each.p95 - each.p05) / (2 * 1.6449)
        assert std < 0.03
        assert each.median == pytest.approx(truth, abs=3 * std)
    assert "k22" in event.text
    assert len(state.recent) == 1 + event.window - 7


def test_the_size_of_a_change_is_revised_by_the_windows_that_follow():
    """Every posterior since compares its springs with those before, and grows surer of it."""
    updater = FoundationUpdater(SmallTower(), LAYOUT, QUICK, seed=5)
    generator, state, posteriors, event = np.random.default_rng(14), updater.initial_state(), [], 0
    for number in range(14):
        ratios = TRUTH * (np.array([1.0, 0.9, 1.0]) if number >= 7 else 1.0)
        state, answers = updater.watched(state, drawn_estimate(ratios, generator, window=number))
        event += sum(isinstance(each, FoundationEvent) for each in answers)
        if event:
            posteriors.append(answers[-1])
        else:
            assert answers[-1].relative == ()
        state = updater.restored(updater.saved(state))
    assert event == 1
    first, last = (each.relative[1] for each in (posteriors[0], posteriors[-1]))
    assert first.name == "k22"
    assert last.p95 - last.p05 < first.p95 - first.p05
    for spring, truth in zip(posteriors[-1].relative, (1.0, 0.9, 1.0), strict=True):
        std = (spring.p95 - spring.p05) / (2 * 1.6449)
        assert spring.median == pytest.approx(truth, abs=3 * std)


def test_springs_that_cannot_stand_together_are_represented_by_the_nearest_draw(updater):
    """Every draw has k11 k22 > k12^2, their medians have not."""
    groups = [[0.72, 0.80, 1.0]] * 9 + [[0.80, 0.72, 1.0]] * 9 + [[0.75, 0.75, 0.98]] * 2
    flat = np.column_stack([np.array(groups), np.zeros(len(groups))])
    medians = np.median(flat[:, :3], axis=0) * NOMINAL
    assert medians[0] * medians[1] < medians[2] ** 2
    draws = PosteriorDraws(flat, flat[:, :3], "", 0, 20.0)
    found = updater._inference._representative(draws, peak=np.ones(3))
    assert found == pytest.approx([0.72, 0.80, 1.0])  # at 1.1 σ; the last two at 3.3 σ of k12


@pytest.mark.parametrize(("varied", "n_unknown"), [(False, 0), (True, 0), (False, 1)])
def test_how_modes_follow_the_water_is_computed_only_where_it_may_have_moved(varied, n_unknown):
    """A hundred solutions of the structure are spared where every window knows one level."""
    asked = []
    fit = SimpleNamespace(
        coordinates=SimpleNamespace(slopes=lambda u: np.eye(3), nominal=np.ones(3)),
        partners_in_water=lambda u, modes: asked.append(u) or [],
    )
    modes = SimpleNamespace(log_frequency_slopes=np.zeros((0, 3)))
    peak = SimpleNamespace(u=np.zeros(3), comparison=SimpleNamespace(linearisation=modes, used=[]))
    evidence = SimpleNamespace(
        level_varied=varied, n_unknown_levels=n_unknown, one_a_track=lambda identified: set()
    )
    found = SimpleNamespace(best=SimpleNamespace(fit=fit, peak=peak), evidence=evidence)
    assert _joint_sensitivities(found, []) == ()
    assert bool(asked) is (varied or n_unknown > 0)
