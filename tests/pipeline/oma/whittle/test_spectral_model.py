"""The spectral matrix of close modes and what the fit needs of it, against independent routes."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.oma.whittle.fit import COLOUR_STD, PRIOR_LINES, _moved, _State, prior_noise
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import CloseModes, expected_matrices, leaked, n_inner
from sensors.arrays import FloatArray

N_MODAL = n_inner(2) + 2 * 3  # parameters of two modes of four channels


def two_modes() -> tuple[CloseModes, NarrowBand]:
    generator = np.random.default_rng(0)
    root = 0.2 * generator.standard_normal((4, 9))
    modes = CloseModes(
        positions=np.array([100.3, 103.1]),
        half_widths=np.array([1.5, 1.0]),
        shapes=generator.standard_normal((4, 2)),
        forces=np.array([[1.0, 0.0], [0.3 + 0.2j, 0.8]]),
        colours=np.array([1.3, -2.0]),
        noise=root @ root.T,
    ).normalised()
    numbers = np.arange(90.0, 115.0)
    lower = np.linalg.cholesky(expected_matrices(modes, numbers))
    white = generator.standard_normal((2, 25, 4, 1)) / np.sqrt(2)
    lines = (lower @ (white[0] + 1j * white[1]))[:, :, 0]
    matrices = lines[:, :, None] * lines[:, None, :].conj()
    return modes, NarrowBand(
        matrices,
        numbers,
        1 + np.arange(len(numbers)) % 3,
        np.ones(4),
        600.0,
        np.zeros(4, dtype=np.int64),
    )


def _parts(step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of the modes and of the background."""
    return step[:N_MODAL], step[N_MODAL:]


def test_the_scale_of_a_shape_is_no_matter() -> None:
    """Twice the shape under half the force is the same motion."""
    modes, band = two_modes()
    scaled = replace(modes, shapes=2.0 * modes.shapes, forces=0.5 * modes.forces)
    expected = expected_matrices(modes, band.numbers)
    np.testing.assert_allclose(expected_matrices(scaled, band.numbers), expected, rtol=1e-12)
    same = expected_matrices(scaled.normalised(), band.numbers)
    np.testing.assert_allclose(same, expected, rtol=1e-12)


def test_the_gradient_is_that_of_differences() -> None:
    modes, band = two_modes()
    prior = prior_noise(band)
    state = _State(modes, band, prior)
    gradient = state.curvature().gradient
    for place, derivative in enumerate(gradient):
        step = np.zeros(len(gradient))
        step[place] = 1e-5
        up, down = (_State(_moved(state, *_parts(s)), band, prior).cost for s in (step, -step))
        assert derivative == pytest.approx((up - down) / 2e-5, abs=1e-6)


def test_the_information_is_that_of_whole_matrices() -> None:
    modes, band = two_modes()
    state = _State(modes, band, prior_noise(band))
    information = state.curvature().information
    n = len(information)
    inverse = np.linalg.inv(expected_matrices(modes, band.numbers))
    derivatives = []
    for step in 1e-5 * np.eye(n):
        up, down = (
            expected_matrices(_moved(state, *_parts(s)), band.numbers) for s in (step, -step)
        )
        derivatives.append(inverse @ (up - down) / 2e-5)
    whole = np.array(
        [
            [np.einsum("k,kij,kji->", band.n_together, a, b).real for b in derivatives]
            for a in derivatives
        ]
    )
    whole[[8, 9], [8, 9]] += COLOUR_STD**-2 / 2  # the prior of the colours
    of_noise = np.arange(N_MODAL, n)
    whole[of_noise, of_noise] += PRIOR_LINES  # and that of the background
    np.testing.assert_allclose(information, whole, atol=1e-7)


def test_leakage_vanishes_for_a_mode_that_the_window_resolves() -> None:
    sigma = 2 * np.pi * np.array([-60.0 + 3j])
    np.testing.assert_allclose(leaked(sigma)[0], -1 / sigma, rtol=0.01)
