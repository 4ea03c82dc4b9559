"""Figures of the structure beside the springs: as uncertain as declared, learned where shown."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior
from pipeline.updating.prior import PriorSettings, UpdatingError
from pipeline.updating.structural_uncertainty import StructuralPrior, UncertainSettings
from pipeline.updating.updater import FoundationUpdater
from tests.pipeline.updating.small_tower import LAYOUT, NOMINAL, SmallTower, drawn_estimate
from tests.pipeline.updating.test_updater import QUICK

HEAVY = UncertainSettings(rna_mass=0.03, steel_modulus=0.01)
RATIOS = np.array([1.1, 0.9, 0.95])


def posterior_of(tower, seed, uncertain, *, method="importance", windows=2, ratios=RATIOS):
    """The posterior after windows drawn from a tower, as an updater has it that believes in the
    described one."""
    settings = replace(QUICK, uncertain=uncertain, sampling=replace(QUICK.sampling, method=method))
    updater = FoundationUpdater(SmallTower(), LAYOUT, settings, seed=seed)
    state, generator = updater.initial_state(), np.random.default_rng([20261121, seed])
    for window in range(windows):
        estimate = drawn_estimate(ratios, generator, window=window, tower=tower)
        state, answer = updater.updated(state, estimate)
    assert isinstance(answer, FoundationPosterior)
    return answer


def held(summary, truth):
    return summary.p05 <= truth <= summary.p95


def test_springs_and_figures_are_held_by_their_intervals_however_far_off_the_figures_are():
    """Mass and modulus drawn from their priors, the tower exact: 90 % intervals of 12 posteriors.

    Binomial, 60 intervals of .9: below 46 once in 1000. All 24 of another run: 112 of 120.
    """
    generator, inside = np.random.default_rng(20261121), 0
    for seed in range(12):
        heavier, stiffer = 1 + generator.standard_normal(2) * HEAVY.stds
        found = posterior_of(
            SmallTower(heavier=heavier, stiffening=stiffer), seed, HEAVY, windows=1
        )
        truths = (*(RATIOS * NOMINAL), heavier, stiffer)
        summaries = (*found.parameters[:3], *found.figures)
        inside += sum(held(*each) for each in zip(summaries, truths, strict=True))
    assert inside >= 46


def test_a_mass_that_is_off_is_learned_and_drags_the_springs_no_more():
    heavy = SmallTower(heavier=1.05)
    only_mass = UncertainSettings(rna_mass=0.03)
    blind = posterior_of(heavy, 3, UncertainSettings())
    aware = posterior_of(heavy, 3, only_mass)
    (mass,) = aware.figures
    assert (mass.name, mass.unit, mass.nominal) == ("rna_mass", "-", 1.0)
    assert held(mass, 1.05)
    assert mass.contraction > 0.5
    truth = RATIOS * NOMINAL
    off = [
        np.abs([p.median / t - 1 for p, t in zip(each.parameters, truth, strict=False)]).max()
        for each in (blind, aware)
    ]
    assert off[1] < off[0]
    assert aware.reduced_chi_square < blind.reduced_chi_square
    assert not blind.figures


def test_another_sampler_gives_the_same_posterior_of_springs_and_figures():
    tower = SmallTower(heavier=0.98)
    first = posterior_of(tower, 5, HEAVY, windows=1)
    other = posterior_of(tower, 5, HEAVY, method="emcee", windows=1)
    for ours, theirs in zip(
        (*first.parameters[:3], *first.figures),
        (*other.parameters[:3], *other.figures),
        strict=True,
    ):
        width = ours.p95 - ours.p05
        assert theirs.median == pytest.approx(ours.median, abs=0.15 * width)
        assert theirs.p95 - theirs.p05 == pytest.approx(width, rel=0.25)


def test_scour_that_nothing_tells_apart_from_soft_springs_is_told_as_not_known():
    """Springs under a wide prior take all that scour could: its posterior is about its prior, and
    the unscoured springs are as uncertain as that makes them."""
    scour = UncertainSettings(scour_depth=1.5)
    known = posterior_of(SmallTower(), 7, UncertainSettings())
    found = posterior_of(SmallTower(), 7, scour)
    (depth,) = found.figures
    assert (depth.name, depth.unit, depth.nominal) == ("scour_depth", "m", 0.0)
    assert depth.p05 > 0.0
    assert depth.contraction < 0.5
    k11, before = found.parameter("k11"), known.parameter("k11")
    assert k11.p95 - k11.p05 > 2 * (before.p95 - before.p05)


def test_the_priors_draws_have_the_density_that_it_says():
    """Importance of the figures' draws under the stated density against its own standard normal."""
    uncertain = UncertainSettings(rna_mass=0.02, scour_depth=2.0)
    prior = StructuralPrior(NOMINAL, PriorSettings(), uncertain)
    draws = prior.draws(4000, np.random.default_rng(1))
    assert prior.supports(draws).mean() > 0.999
    assert draws[:, 3].std() == pytest.approx(0.02, rel=0.05)
    assert draws[:, 4].min() >= 0
    uniform = np.column_stack(
        [
            draws[:, :3],
            np.random.default_rng(2).uniform(-0.1, 0.1, 4000),
            np.random.default_rng(3).uniform(0.0, 10.0, 4000),
        ]
    )
    integral = np.exp(prior.log_density(uniform)).mean() * 0.2 * 10.0
    assert integral == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        (
            {"rna_mass": 0.5},
            r"rna_mass is 0.5; a prior's standard deviation from 0 \(known\) to 0.3",
        ),
        ({"scour_depth": -1.0}, r"scour_depth is -1; .* from 0 \(known\) upwards"),
    ],
)
def test_a_figure_that_cannot_be_so_uncertain_is_named(figures, message):
    with pytest.raises(UpdatingError, match=message):
        UncertainSettings(**figures)
