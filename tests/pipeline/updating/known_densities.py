"""Posteriors whose moments, marginals and evidence are known in closed form."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from pipeline.updating.samplers.interface import Peak, Target

BOX = (-5.0, 5.0)  # uniform prior in every dimension
MEAN = np.array([1.0, 2.0, -0.5])
FACTOR = np.array([[0.01, 0, 0], [0.018, 0.004, 0], [0.012, 0.003, 0.001]])  # correlations to .99
COVARIANCE = FACTOR @ FACTOR.T


def target_of(log_likelihood, peak, covariance, *, ensemble=None):
    """A Target under the uniform prior of the box, with the first coordinate as companion."""

    def log_density(points):
        inside = ((points > BOX[0]) & (points < BOX[1])).all(axis=1)
        values = np.full(len(points), -np.inf)
        values[inside] = log_likelihood(points[inside])
        return values, points[:, 0].copy()

    n_dim = len(peak)
    return Target(
        log_density=log_density,
        prior_draws=lambda n, generator: generator.uniform(*BOX, size=(n, n_dim)),
        log_prior_volume=n_dim * np.log(BOX[1] - BOX[0]),
        peak=Peak(np.asarray(peak, dtype=float), np.asarray(covariance, dtype=float)),
        ensemble=ensemble,
    )


@dataclass(frozen=True)
class Known:
    """A target, its log evidence, and its marginal distribution functions."""

    target: Target
    log_evidence: float
    marginals: tuple


def gaussian(*, peak=MEAN, covariance=COVARIANCE, ensemble=None):
    """Sharp and correlated: exp(−½ δᵀ S⁻¹ δ), of integral (2π)^(3/2) √det S."""

    def log_likelihood(points):
        return -0.5 * (np.linalg.solve(FACTOR, (points - MEAN).T) ** 2).sum(axis=0)

    volume = 1.5 * np.log(2 * np.pi) + np.log(np.diag(FACTOR)).sum()
    deviations = np.sqrt(np.diag(COVARIANCE))
    return Known(
        target_of(log_likelihood, peak, covariance, ensemble=ensemble),
        volume - 3 * np.log(10.0),
        tuple(lambda x, m=m, s=s: ndtr((x - m) / s) for m, s in zip(MEAN, deviations, strict=True)),
    )


def banana():
    """x ~ N(0, .3²), y − 3 x² ~ N(0, .15²), z ~ N(0, 1): bent across three of its widths."""

    def log_likelihood(points):
        x, y, z = points.T
        return -0.5 * ((x / 0.3) ** 2 + ((y - 3 * x**2) / 0.15) ** 2 + z**2)

    volume = 1.5 * np.log(2 * np.pi) + np.log(0.3 * 0.15)
    return Known(
        target_of(log_likelihood, np.zeros(3), np.diag([0.3, 0.15, 1.0]) ** 2),
        volume - 3 * np.log(10.0),
        (lambda x: ndtr(x / 0.3), None, ndtr),
    )


def two_peaks(*, peak=(-2.0, -2.0)):
    """A quarter at (2, 2) and three quarters at (−2, −2), both N(·, .1²): forty widths apart."""
    centres, shares = np.array([[2.0, 2.0], [-2.0, -2.0]]), np.array([0.25, 0.75])

    def log_likelihood(points):
        squares = ((points[:, None] - centres) ** 2).sum(axis=2) / 0.1**2
        return np.logaddexp.reduce(np.log(shares) - 0.5 * squares, axis=1)

    def marginal(x):
        return shares[0] * ndtr((x - 2) / 0.1) + shares[1] * ndtr((x + 2) / 0.1)

    return Known(
        target_of(log_likelihood, peak, np.eye(2) * 0.01),
        np.log(2 * np.pi * 0.01) - 2 * np.log(10.0),
        (marginal, marginal),
    )


def kolmogorov_distance(draws, distribution):
    """Largest distance between draws' empirical distribution function and a known one."""
    draws = np.sort(draws)
    n = len(draws)
    values = distribution(draws)
    steps = np.arange(n + 1) / n
    return max(np.abs(values - steps[1:]).max(), np.abs(values - steps[:-1]).max())
