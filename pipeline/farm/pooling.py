"""Partial pooling: turbines alike but not equal, each lending the others what it knows.

    x_i = b_i + z_i o_i          springs of turbine i, any d coordinates
    b_i ~ N(μ, Σ)                what its builders meant, and the soil's scatter
    o_i ~ N(0, W), z_i ~ Bernoulli(ε)      some are different, by much more than the others
    ĉ_i ~ N(r_i + z_i o_i, V_i)  a change that turbine i's own record shows (`own_changes`)
    r_i ~ N(0, U)                what may change of one that stays like the others; a share of
                                 changes is not the foundation's (`gibbs.OutlierPriors`)
    data_i ~ p(data_i | x_i)     a mixture of Gaussians in x_i (`evidence`)

    μ ~ N(0, s² I),   ε ~ Beta(α, β)
    Σ | τ ~ IW(κ, (κ − d − 1) τ² S),   κ = d + 1 + `alike`,   τ ~ half-t(ν, A)

so that E Σ = τ² S: one spread τ for all springs, of the shape S that equal and independent spreads
of ln k11, ln k22 and ln k12 have in x, which `alike` degrees of freedom hold Σ to. Why not a free
Σ: five turbines cannot show six numbers, and a farm that is pooled by a Σ of its noise is pooled
too little or too much. τ is inferred with its uncertainty (half-t: Gelman 2006, Bayesian Analysis
1, 515).

An outlier's o_i takes up what is unlike the others, so that it widens neither Σ nor their
posteriors (Box and Tiao 1968, Biometrika 55, 119, for the contaminated Gaussian). How sure it is
that a turbine is one is asked of that turbine alone, against the others: the Bayes factor

    B_i = E₋ᵢ p(data_i | z_i = 1) / E₋ᵢ p(data_i | z_i = 0)

with the expectations over the farm as the others show it, of spread and mean unsure, times the odds
α / β that were thought of a turbine beforehand. Why not the posterior probability of z_i = 1: its
odds are those of ε given the others, so that nineteen regular turbines speak against the twentieth
being an outlier, and one outlier makes another likelier. data_i has ĉ_i in it, where the turbine
was seen to change: so does B_i.

The draws come from `gibbs`.

Why the turbines' own intervals are believed as they are: an error of the model that all turbines
share widens every interval and shows in no difference between them, so one factor f on all widths
suggests itself, to be found from the farm. It cannot be: turbines scatter by Σ + f² C, and every f
for which a scatter S leaves S − f² C positive definite explains it as well as another. Of farms of
twenty that spread by 2 %, seen through ten minutes of all modes, with errors half as large as
stated, f may be anything up to 1.1 [.8, 1.5]. Nor does it help to leave it open: a share of C that
is common to all, uniform a priori, came out as it went in, and the errors stayed what they were.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.farm.evidence import StackedEvidence
from pipeline.farm.gibbs import Gibbs, State
from pipeline.farm.settings import GibbsSettings, PopulationPrior
from pipeline.updating.samplers.convergence import effective_sample_size, split_rhat
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PooledDraws:
    """Draws of the farm and its turbines, sweep by sweep, the chains one behind the other."""

    means: FloatArray
    """μ, (n_draws, d)."""
    covariances: FloatArray
    """Σ, (n_draws, d, d)."""
    outlier_shares: FloatArray
    """ε, (n_draws,)."""
    points: FloatArray
    """x, (n_draws, n_turbines, d)."""
    outlier_probabilities: FloatArray
    """Each turbine's, against the others, (n_turbines,)."""
    ess: float
    """Smallest effective sample size over μ and √Σ_jj."""
    rhat: float
    """Largest split R̂ over the same."""

    def with_common_errors(
        self, common: FloatArray, generator: np.random.Generator
    ) -> "PooledDraws":
        """Turbines and mean moved by one draw of the description's errors each sweep.

        Parameters
        ----------
        common : ndarray, shape (n_turbines, n_figures, d)
            L, what an error of one standard deviation of each figure moves.
        generator : numpy.random.Generator
            That the errors are drawn with.
        """
        xi = generator.standard_normal((len(self.points), common.shape[1]))
        moved = np.einsum("nf,tfd->ntd", xi, common)
        return replace(self, points=self.points + moved, means=self.means + moved.mean(axis=1))


def pooled(
    evidence: StackedEvidence,
    prior: PopulationPrior,
    generator: np.random.Generator,
    settings: GibbsSettings | None = None,
    shape: FloatArray | None = None,
) -> PooledDraws:
    """Draws of the population and of every turbine given all turbines' evidence.

    Parameters
    ----------
    evidence : StackedEvidence
        Of all turbines.
    prior : PopulationPrior
        Of the population's mean and covariance.
    generator : numpy.random.Generator
        That they are drawn with.
    settings : GibbsSettings, optional
        The defaults where left out.
    shape : ndarray, shape (d, d), optional
        S; None: the unit matrix.
    """
    settings = settings or GibbsSettings()
    gibbs = Gibbs(evidence, prior, generator, shape)
    state = gibbs.start(settings.chains)
    for _ in range(settings.burn_in):
        gibbs.sweep(state)
    for number in range(settings.rounds):
        drawn = _drawn(gibbs, state, settings.sweeps * 2**number, prior.outliers / prior.regular)
        if drawn.rhat <= settings.rhat:
            break
    return drawn


def _drawn(gibbs: Gibbs, state: State, sweeps: int, odds: float) -> PooledDraws:
    """Return the sweeps that follow a state.

    odds   of a turbine's being an outlier, beforehand
    """
    n_chains, d = state.mean.shape
    size = (sweeps, n_chains)
    means, covariances = np.empty((*size, d)), np.empty((*size, d, d))
    shares, points, likelihoods = np.empty(size), [], []
    for sweep in range(sweeps):
        share = state.outlier_share[:, None]
        x, outlying = gibbs.sweep(state)
        likelihoods.append((outlying / share, (1 - outlying) / (1 - share)))
        means[sweep], covariances[sweep] = state.mean, state.covariance
        shares[sweep] = state.outlier_share
        points.append(x)
    spreads = np.sqrt(np.diagonal(covariances, axis1=2, axis2=3))
    watched = np.concatenate([means, spreads], axis=2)
    return PooledDraws(
        means=means.reshape(-1, d),
        covariances=covariances.reshape(-1, d, d),
        outlier_shares=shares.ravel(),
        points=np.concatenate(points),
        outlier_probabilities=_outlier_probabilities(np.array(likelihoods), odds),
        ess=min(effective_sample_size(each) for each in np.moveaxis(watched, 2, 0)),
        rhat=max(split_rhat(each) for each in np.moveaxis(watched, 2, 0)),
    )


def _outlier_probabilities(likelihoods: FloatArray, odds: float) -> FloatArray:
    """(n_turbines,) from p(data_i | z_i) / p(data_i) of each draw of the farm, z_i = 1 and 0,
    (n_sweeps, 2, n_chains, n_turbines).

    A draw given all turbines' data, weighted by 1 / p(data_i), is one given the others' alone: the
    mean of these ratios over the draws is proportional to E₋ᵢ p(data_i | z_i).
    Source: Gelfand, Dey and Chang (1992), Bayesian Statistics 4, 147.
    """
    outlying, regular = likelihoods.mean(axis=(0, 2))
    return np.asarray(odds * outlying / (odds * outlying + regular))
