"""A farm's prior of one more turbine: its density, its file, and what it does to a posterior."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pipeline.updating.population import (
    StiffnessPopulation,
    load_population,
    log_gaussian,
    population_from_json,
)
from pipeline.updating.prior import UpdatingError
from pipeline.updating.updater import FoundationUpdater
from tests.pipeline.updating.small_tower import LAYOUT, NOMINAL, LinearTower, drawn_estimate


def population(n=5, *, mean=0.0, std=0.02, share=0.05, seed=1):
    """A farm about e^mean times nominal."""
    generator = np.random.default_rng(seed)
    return StiffnessPopulation(
        turbines=("t1", "t2", "t3"),
        nominal=NOMINAL,
        means=np.array([mean, mean, 0.0]) + 0.1 * std * generator.standard_normal((n, 3)),
        covariances=std**2 * generator.uniform(0.5, 2.0, n)[:, None, None] * np.eye(3),
        outlier_shares=np.full(n, share),
        outlier_std=0.2,
    )


def test_the_log_density_of_gaussians_is_scipys():
    generator = np.random.default_rng(31)
    root = generator.standard_normal((4, 3, 3))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(3)
    offsets = generator.standard_normal((4, 3))
    expected = [
        stats.multivariate_normal.logpdf(o, cov=c) for o, c in zip(offsets, covariance, strict=True)
    ]
    np.testing.assert_allclose(log_gaussian(offsets, covariance), expected, rtol=1e-10)


def test_its_density_has_the_integral_one_and_is_that_of_its_draws():
    farm, generator = population(std=0.05), np.random.default_rng(2)
    wide = replace(farm, covariances=2 * farm.covariances, outlier_shares=np.full(5, 0.3))
    points = wide.draws(40_000, generator)
    weights = np.exp(farm.log_density(points) - wide.log_density(points))
    assert weights.mean() == pytest.approx(1.0, abs=0.02)
    drawn = farm.draws(40_000, generator)
    for column in range(3):
        assert np.average(points[:, column] < 0.97, weights=weights) == pytest.approx(
            np.mean(drawn[:, column] < 0.97), abs=0.02
        )


def test_a_population_read_again_has_the_same_density(tmp_path):
    path, farm = tmp_path / "farm.json", population()
    path.write_text(farm.as_json(), encoding="utf-8")
    ratios = farm.draws(10, np.random.default_rng(3))
    again = load_population(path)
    np.testing.assert_array_equal(again.log_density(ratios), farm.log_density(ratios))
    assert again.name == "3 turbines, t1 … t3"


def test_errors_of_the_description_widen_the_prior_of_an_exact_structure(tmp_path):
    farm = replace(
        population(std=0.02, share=0.001), figures=("E",), common=np.array([[0.1, 0.2, 0.0]])
    )
    stds = np.log(farm.draws(40_000, np.random.default_rng(6))).std(axis=0)
    np.testing.assert_allclose(stds[:2], [0.1, 0.2], rtol=0.06)
    described = np.log(farm.as_described(40_000, np.random.default_rng(6))).std(axis=0)
    assert described[1] < 0.04
    path = tmp_path / "farm.json"
    path.write_text(farm.as_json(), encoding="utf-8")
    again, ratios = load_population(path), farm.draws(10, np.random.default_rng(3))
    assert again.figures == ("E",)
    np.testing.assert_array_equal(again.log_density(ratios), farm.log_density(ratios))


def test_a_population_of_before_there_were_errors_of_the_description_is_read():
    content = json.loads(population().as_json())
    del content["figures"], content["common"]
    assert population_from_json(json.dumps(content), "farm.json").common.shape == (0, 3)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"format": "something else"}, "format"),
        ({"means": [[0, 0]]}, "means has the shape"),
        ({"outlier_shares": [0.0] * 5}, "between 0 and 1"),
        ({"covariances": np.zeros((5, 3, 3)).tolist()}, "not positive definite"),
        ({"turbines": []}, "learned from nothing"),
    ],
)
def test_what_is_no_population_is_refused_with_its_reason(change, complaint):
    content = json.loads(population().as_json()) | change
    with pytest.raises(UpdatingError, match=complaint):
        population_from_json(json.dumps(content), "farm.json")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UpdatingError, match=r"farm\.json cannot be read .*pilewatch farm --prior"):
        load_population(tmp_path / "farm.json")


def test_a_population_of_other_foundations_is_refused():
    other = replace(population(), nominal=2 * NOMINAL)
    with pytest.raises(UpdatingError, match="foundations about"):
        FoundationUpdater(LinearTower(), LAYOUT, population=other)


def posterior_ratios(farm, estimate):
    updater = FoundationUpdater(LinearTower(), LAYOUT, population=farm)
    _, posterior = updater.updated(updater.initial_state(), estimate)
    return posterior, posterior.draws[:, :3] / NOMINAL


def test_a_posterior_with_a_population_is_the_uniform_ones_reweighted():
    """Draws under the uniform prior, weighted by the population's density, are the second route."""
    estimate = drawn_estimate(
        np.array([1.05, 0.97, 1.02]),
        np.random.default_rng(4),
        tower=LinearTower(),
        frequency_std=0.005,
        shape_std=0.05,
    )
    farm = population(std=0.06)
    plain, ratios = posterior_ratios(None, estimate)
    pooled, narrowed = posterior_ratios(farm, estimate)
    log_weights = farm.log_density(ratios)
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    assert 1 / (weights**2).sum() > 200
    mean = weights @ ratios
    std = np.sqrt(weights @ (ratios - mean) ** 2)
    np.testing.assert_array_less(np.abs(narrowed.mean(axis=0) - mean), 0.25 * std)
    np.testing.assert_allclose(narrowed.std(axis=0), std, rtol=0.2)
    assert np.all(narrowed.std(axis=0) < ratios.std(axis=0))
    assert (plain.population, pooled.population) == ("", "3 turbines, t1 … t3")
