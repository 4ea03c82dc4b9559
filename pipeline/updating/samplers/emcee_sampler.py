"""Markov chains through emcee: an ensemble that proposes from a density fitted to itself."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.convergence import (
    autocorrelation_time,
    effective_sample_size,
    split_rhat,
)
from pipeline.updating.samplers.interface import LogDensity
from pipeline.updating.samplers.student_t import DEGREES_OF_FREEDOM
from sensors.arrays import FloatArray
from sensors.settings import NO_KEY


def fitted_student_proposal(
    moving: FloatArray, standing: list[FloatArray], random: np.random.RandomState
) -> tuple[FloatArray, FloatArray]:
    """Draw independently from a Student-t with mean and covariance of the other half's walkers.

    Parameters
    ----------
    moving : ndarray, shape (n, n_dim)
        Walkers that a step is proposed to.
    standing : list of ndarray, shape (n_standing, n_dim)
        The other half's walkers.
    random : numpy.random.RandomState
        emcee's own.

    Returns
    -------
    proposed : ndarray, shape (n, n_dim)
        Points.
    log_ratio : ndarray, shape (n,)
        log q(old) − log q(new).

    Notes
    -----
    A Gaussian kernel density of the same walkers (emcee's KDEMove) has light tails: a walker that
    starts further out than its fellows is hardly ever proposed a way back, and stays. The step
    obeys detailed balance because the other half stands still while this one moves.

    References
    ----------
    Foreman-Mackey et al. 2013, §2.
    """
    others = np.concatenate(standing, axis=0)
    mean = others.mean(axis=0)
    factor = np.asarray(np.linalg.cholesky(np.cov(others.T)))
    scale = random.chisquare(DEGREES_OF_FREEDOM, size=len(moving)) / DEGREES_OF_FREEDOM
    normal = random.standard_normal(moving.shape)
    proposed = mean + (normal / np.sqrt(scale)[:, None]) @ factor.T
    return proposed, _log_student(moving, mean, factor) - _log_student(proposed, mean, factor)


def _log_student(points: FloatArray, mean: FloatArray, factor: FloatArray) -> FloatArray:
    """Log density of the multivariate Student-t at points, (n, n_dim), constant dropped."""
    squares = np.asarray(np.linalg.solve(factor, (points - mean).T) ** 2).sum(axis=0)
    return -(DEGREES_OF_FREEDOM + points.shape[1]) / 2 * np.log1p(squares / DEGREES_OF_FREEDOM)


def fitting_moves() -> list[tuple[Any, float]]:
    """Moves with their shares: the Student-t mostly; the kernel density where the density is
    bent; differences of two walkers for one that both proposals have left behind."""
    import emcee  # not above: a tower unit reads these settings and never samples

    class FittedStudentMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee has no types
        """`fitted_student_proposal` as emcee calls it."""

        def get_proposal(
            self, moving: FloatArray, standing: list[FloatArray], random: np.random.RandomState
        ) -> tuple[FloatArray, FloatArray]:
            return fitted_student_proposal(moving, standing, random)

    return [(FittedStudentMove(), 0.7), (emcee.moves.KDEMove(), 0.25), (emcee.moves.DEMove(), 0.05)]


@dataclass(frozen=True, slots=True)
class SamplerSettings:
    """How long the chains are."""

    walkers: int = 40
    """Number of walkers; even, 16 or more."""
    burn_in: int = field(default=25, metadata=NO_KEY)
    """Steps that are thrown away."""
    block: int = field(default=25, metadata=NO_KEY)
    """Steps between two looks at the autocorrelation."""

    most_steps: int = field(default=600, metadata=NO_KEY)
    """Where a chain that is still too short is given up."""

    chain_in_autocorrelation_times: float = field(default=50.0, metadata=NO_KEY)
    """Shortest chain that is trusted [τ]."""

    effective_draws: float = 1000.0
    """Effective draws at which the chain is long enough."""

    def __post_init__(self) -> None:
        if self.walkers < 16 or self.walkers % 2:
            raise UpdatingError(f"walkers is {self.walkers}; an even number from 16 is needed")
        if not 4 <= self.block <= self.most_steps:
            raise UpdatingError(
                f"block is {self.block} and most_steps {self.most_steps}; 4 <= block <= most_steps"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """An ensemble's walk after burn-in."""

    points: FloatArray
    """(n_steps, n_walkers, n_dim)."""
    companions: FloatArray
    """(n_steps, n_walkers)."""
    autocorrelation_time: float
    """Largest over dimensions and companion [steps]."""
    ess: float
    """Smallest effective sample size."""
    rhat: float
    """Largest split R̂."""
    long_enough: bool
    """At least 50 τ and the wanted effective draws."""

    @property
    def flat(self) -> FloatArray:
        """(n_steps · n_walkers, n_dim + 1) points with their companion, step by step."""
        joined = np.concatenate([self.points, self.companions[..., None]], axis=2)
        return joined.reshape(-1, joined.shape[2])

    @property
    def ensemble(self) -> FloatArray:
        """(n_walkers, n_dim) where the walkers stand at the end."""
        return self.points[-1]


def ensemble_chains(
    log_density: LogDensity,
    start: FloatArray,
    settings: SamplerSettings,
    generator: np.random.Generator,
) -> Chains:
    """Chains of an ensemble sampler from points of finite density.

    Parameters
    ----------
    log_density : LogDensity
        Of (n, n_dim) points.
    start : ndarray, shape (n_walkers, n_dim)
        All of finite density.
    settings : SamplerSettings
        With the length of the chains.
    generator : numpy.random.Generator
        That the sampler is seeded with.

    Notes
    -----
    Each half of the walkers proposes from a density fitted to the other half (`moves`). On sharp,
    strongly correlated posteriors such chains forget within a few steps where the stretch move
    needs fifty. The chain grows by blocks until it is 50 autocorrelation times long.
    """
    import emcee

    sampler = emcee.EnsembleSampler(
        *start.shape,
        lambda points: np.column_stack(log_density(points)),
        moves=fitting_moves(),
        vectorize=True,
    )
    seed = generator.integers(2**32, size=4, dtype=np.uint32)
    state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
    state = sampler.run_mcmc(state, settings.burn_in, store=False)
    while True:
        state = sampler.run_mcmc(state, settings.block)
        chains = _assessed(sampler, settings)
        n_steps = len(chains.points)
        if chains.long_enough or n_steps + settings.block > settings.most_steps:
            return chains


def _assessed(sampler: Any, settings: SamplerSettings) -> Chains:
    points = sampler.get_chain()
    companions = np.asarray(sampler.get_blobs(), dtype=float)
    quantities = [*np.moveaxis(points, 2, 0), companions]
    tau = max(autocorrelation_time(each) for each in quantities)
    ess = min(effective_sample_size(each) for each in quantities)
    wanted = settings.chain_in_autocorrelation_times * tau
    return Chains(
        points=points,
        companions=companions,
        autocorrelation_time=tau,
        ess=ess,
        rhat=max(split_rhat(each) for each in quantities),
        long_enough=bool(len(points) >= wanted and ess >= settings.effective_draws),
    )
