"""A linear comparison of three modes, small enough to be solved by hand."""

from typing import Any, cast

import numpy as np

from pipeline.updating.likelihood.mode_errors import ModeErrors

GROUPS = np.array([0, 0, 0, 1, 1, 1, 2, 2, 2])  # a frequency and two components of a shape each


def comparison(seed: int, n_dim: int, *, tracks: tuple[int, int, int] = (0, 1, 2)) -> ModeErrors:
    """Errors well below their standard deviations: none counts as an outlier."""
    generator = np.random.default_rng(seed)
    variances, floors = generator.uniform(0.5, 2.0, 9), generator.uniform(0.1, 1.0, 9)
    return ModeErrors(
        pairing=cast(Any, None),
        used=cast(Any, (None,) * 3),
        errors=0.3 * generator.standard_normal(9),
        variances=variances,
        floors=floors,
        reference=np.ones(9),
        jacobian=generator.standard_normal((9, n_dim)),
        groups=GROUPS,
        is_frequency=np.arange(9) % 3 == 0,
        tracks=np.repeat(tracks, 3),
        rows=np.arange(9) % 3,
        units=np.zeros(9, dtype=int),
        damping_ratios=np.full(3, np.nan),
        linearisation=cast(Any, None),
    )
