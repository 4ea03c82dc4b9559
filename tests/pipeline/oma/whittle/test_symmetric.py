"""Components of symmetric matrices against products with every direction."""

import numpy as np

from pipeline.oma.whittle.spectral_model import (
    along_symmetric,
    information_along_symmetric,
    symmetric_of,
)

N = 4
N_DIRECTIONS = N * (N + 1) // 2
DIRECTIONS = [symmetric_of(one, N) for one in np.eye(N_DIRECTIONS)]


def test_the_directions_are_orthonormal() -> None:
    gram = [[np.trace(one @ other) for other in DIRECTIONS] for one in DIRECTIONS]
    np.testing.assert_allclose(gram, np.eye(N_DIRECTIONS), atol=1e-14)


def test_components_are_traces() -> None:
    matrix = np.random.default_rng(1).standard_normal((N, N))
    expected = [np.trace(matrix @ one) for one in DIRECTIONS]
    np.testing.assert_allclose(along_symmetric(matrix.ravel(), N), expected, atol=1e-14)


def test_information_is_that_of_whole_products() -> None:
    generator = np.random.default_rng(2)
    parts = generator.standard_normal((2, 7, N, N))
    half = parts[0] + 1j * parts[1]
    matrices, counts = half + half.conj().transpose(0, 2, 1), 1 + np.arange(7)
    expected = [
        [
            sum(
                n * np.trace(e @ one @ e @ other).real
                for n, e in zip(counts, matrices, strict=True)
            )
            for other in DIRECTIONS
        ]
        for one in DIRECTIONS
    ]
    np.testing.assert_allclose(information_along_symmetric(matrices, counts), expected, atol=1e-10)
