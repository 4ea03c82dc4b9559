"""What the modes of one window have in common: by closed form, by differences, by coverage."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.identification import identify
from pipeline.oma.ssi.band_identification import mode_from_factor
from pipeline.oma.ssi.uncertainty import (
    frequency_damping_deviations,
    order_deviations,
    pole_deviations,
    projected_deviations,
    state_deviations,
)
from sensors.arrays import FloatArray
from tests.pipeline.oma.conftest import KnownStructure
from tests.pipeline.oma.ssi.test_uncertainty import (  # noqa: F401  # a fixture
    DT,
    covariances,
    identified,
    moved_by,
    physical,
)
from tests.tiers import and_at_night


def joint_factor(modes: Sequence[Mode]) -> FloatArray:
    """F of all modes of one estimate, (n_modes·(2 + n_channels), n_columns); F Fᵀ is their joint
    covariance.

    Rows: frequency [Hz], damping ratio [-] and shape [-] of the first mode, then of the next. The
    columns of the time blocks are common to all modes (a slower band may lack the last blocks);
    after them come every mode's own.
    """
    n_blocks = max(mode.n_block_columns for mode in modes)
    n_rows = len(modes[0].covariance_factor)
    n_own = [mode.covariance_factor.shape[1] - mode.n_block_columns for mode in modes]
    factor = np.zeros((len(modes), n_rows, n_blocks + sum(n_own)))
    first = n_blocks
    for rows, mode, own in zip(factor, modes, n_own, strict=True):
        rows[:, : mode.n_block_columns] = mode.covariance_factor[:, : mode.n_block_columns]
        rows[:, first : first + own] = mode.covariance_factor[:, mode.n_block_columns :]
        first += own
    return factor.reshape(len(modes) * n_rows, -1)


def joint_covariance(modes: Sequence[Mode]) -> FloatArray:
    """Covariance of frequencies, damping ratios and shapes of all modes of one estimate, square,
    rows as in `joint_factor`.

    Its rank is at most the number of columns: with some forty blocks a few modes' components are
    all that it can hold apart.
    """
    factor = joint_factor(modes)
    return np.asarray(factor @ factor.T)


def test_diagonal_blocks_are_the_modes_own_covariances(cantilever: KnownStructure) -> None:
    y = cantilever.ambient_response(sampling_rate=40.0, duration=300.0, seed=41)
    modes = identify(y, 40.0).modes
    joint = joint_covariance(modes)
    n = 2 + 5
    assert joint.shape == (n * len(modes), n * len(modes))
    for place, mode in enumerate(modes):
        own = slice(n * place, n * (place + 1))
        np.testing.assert_allclose(joint[own, own], mode.covariance, atol=1e-18)
    values = np.linalg.eigvalsh(joint)
    assert values.min() > -1e-12 * values.max()


def test_what_only_one_mode_knows_is_in_no_other() -> None:
    """Deviations of f: 1, 2 by block and 5 alone; 1 by block (one is lacking) and 5 alone."""
    mode = mode_from_factor(
        frequency=1.0,
        damping_ratio=0.01,
        shape=np.ones(1),
        block_factor=np.array([[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]]),
        own_factor=np.array([[5.0], [0.0], [0.0]]),
        phase_collinearity=1.0,
        presence=1.0,
    )
    other = replace(mode, covariance_factor=mode.covariance_factor[:, [0, 2]], n_block_columns=1)
    joint = joint_covariance([mode, other])
    np.testing.assert_allclose(joint[[0, 0, 3], [0, 3, 3]], [1 + 4 + 25, 1, 1 + 25])


def test_between_modes_it_is_the_product_of_differences(covariances) -> None:  # noqa: F811
    """cov(f_1, f_2) = Σ_b Δf_1 Δf_2, with Δf from identifying the moved covariances anew."""
    subspace, system = identified(covariances.mean)
    chosen = physical(system)
    projected = projected_deviations(subspace, covariances.deviations)
    moved = state_deviations(order_deviations(projected, system), chosen)
    analytic = frequency_damping_deviations(system.poles[chosen], pole_deviations(moved), DT)
    modes = [
        mode_from_factor(
            frequency=float(system.frequencies[index]),
            damping_ratio=float(system.damping_ratios[index]),
            shape=np.ones(1),
            block_factor=np.vstack([f, zeta, np.zeros_like(f)]),
            own_factor=np.zeros((3, 0)),
            phase_collinearity=1.0,
            presence=1.0,
        )
        for index, f, zeta in zip(chosen, analytic.frequency, analytic.damping_ratio, strict=True)
    ]
    step, differences = 1e-4, []
    for block in range(len(covariances.blocks)):
        plus, minus = (moved_by(covariances, block, sign * step) for sign in (1, -1))
        both = plus.frequencies[physical(plus)] - minus.frequencies[physical(minus)]
        differences.append(both / (2 * step))
    expected = np.transpose(differences) @ np.array(differences)
    joint = joint_covariance(modes)[np.ix_([0, 3], [0, 3])]
    np.testing.assert_allclose(joint, expected, rtol=5e-3, atol=2e-3 * expected.max())


@pytest.mark.parametrize("seeds", and_at_night(range(500, 510), range(510, 540)))
def test_frequencies_of_a_window_lie_jointly_as_far_from_the_truth_as_it_says(
    two_mass_system: KnownStructure, seeds: range
) -> None:
    """The mean squared Mahalanobis distance of n frequencies is n ν/(ν − n − 1) with the
    covariance from ν + 1 blocks, n where the lines tell it; N windows show it to a standard
    deviation of √(2n/N)."""
    truth = two_mass_system.frequencies
    distances, expected = [], []
    for seed in seeds:
        y = two_mass_system.ambient_response(sampling_rate=20.0, duration=300.0, seed=seed)
        everything = identify(y, 20.0).modes
        modes = [m for f in truth for m in everything if abs(m.frequency - f) < 0.02 * f]
        if len(modes) < 2:  # one wasn't found in this window
            continue
        error = np.array([m.frequency for m in modes]) - truth
        covariance = joint_covariance(modes)[np.ix_([0, 4], [0, 4])]
        distances.append(error @ np.linalg.solve(covariance, error))
        n_blocks = min(mode.n_block_columns for mode in modes)
        expected.append(2 * (n_blocks - 1) / (n_blocks - 1 - 3) if n_blocks else 2.0)
    assert len(distances) >= 0.65 * len(seeds)
    bound = 3 * np.sqrt(4 / len(distances))
    assert np.mean(distances) == pytest.approx(np.mean(expected), abs=bound)
