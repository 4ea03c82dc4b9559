"""The covariance of everything that one window says, across its modes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import Mode

FloatArray = NDArray[np.float64]


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
