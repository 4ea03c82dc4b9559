"""Structures under ambient load whose modes are known, for the identification to find."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import linalg

from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class KnownStructure:
    """Modes that are known, and the accelerations they show under white modal forces."""

    frequencies: FloatArray  # undamped, (n_modes,) [Hz]
    damping_ratios: FloatArray  # (n_modes,) [-]
    shapes: FloatArray  # (n_modes, n_channels), largest component 1 [-]

    def ambient_response(
        self,
        *,
        sampling_rate: float,
        duration: float,
        seed: int,
        noise: float = 0.03,
        excitation: Sequence[float] | None = None,
    ) -> FloatArray:
        """Accelerations, (n, n_channels), with white sensor noise (share of each channel's rms).

        Every mode is an independent oscillator q'' + 2ζω q' + ω² q = white noise, sampled exactly
        (Van Loan's matrix exponential), started in its stationary state and scaled to an rms
        acceleration of 1 (or `excitation`), so nothing depends on the step.
        """
        generator = np.random.default_rng(seed)
        n = round(duration * sampling_rate)
        rms = np.ones(len(self.frequencies)) if excitation is None else np.asarray(excitation)
        modal = np.column_stack(
            [
                level * _oscillator_acceleration(f, zeta, sampling_rate, n, generator)
                for f, zeta, level in zip(self.frequencies, self.damping_ratios, rms, strict=True)
            ]
        )
        clean = modal @ self.shapes
        return clean + noise * clean.std(axis=0) * generator.standard_normal(clean.shape)


def _oscillator_acceleration(
    frequency: float, damping: float, sampling_rate: float, n: int, generator: np.random.Generator
) -> FloatArray:
    """−2ζω q' − ω² q of one oscillator, unit rms, (n,)."""
    omega, dt = 2 * np.pi * frequency, 1 / sampling_rate
    A = np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]])
    intensity = np.diag([0.0, 1.0])
    van_loan = linalg.expm(np.block([[-A, intensity], [np.zeros((2, 2)), A.T]]) * dt)
    transition = van_loan[2:, 2:].T
    step_noise = np.linalg.cholesky(transition @ van_loan[:2, 2:])
    stationary = np.linalg.cholesky(linalg.solve_continuous_lyapunov(A, -intensity))
    state = stationary @ generator.standard_normal(2)
    kicks = generator.standard_normal((n, 2)) @ step_noise.T
    states = np.empty((n, 2))
    for k in range(n):
        states[k] = state
        state = transition @ state + kicks[k]
    acceleration = states @ A[1]
    return np.asarray(acceleration / np.linalg.norm(A[1] @ stationary))


def structure(
    frequencies: Sequence[float], damping_ratios: Sequence[float] | float, shapes: FloatArray
) -> KnownStructure:
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=1)[:, None], axis=1)
    damping = np.broadcast_to(damping_ratios, (len(frequencies),)).astype(float)
    return KnownStructure(np.asarray(frequencies, dtype=float), damping, shapes / largest)


@pytest.fixture(scope="session")
def two_mass_system() -> KnownStructure:
    """Two equal masses in a row on two equal springs, 1 % damping: ω² = k/m·(3 ∓ √5)/2."""
    golden = (1 + np.sqrt(5)) / 2
    natural = 2.0  # sqrt(k/m) / 2π [Hz]
    return structure(
        [natural / golden, natural * golden], 0.01, np.array([[1.0, golden], [golden, -1.0]])
    )


@pytest.fixture(scope="session")
def cantilever() -> KnownStructure:
    """A clamped uniform tower with five sensors: ω ∝ (βL)², 0.8 % damping, 0.32 Hz and up."""
    beta = np.array([1.8751041, 4.6940911, 7.8547574])  # roots of cos βL cosh βL = −1
    x = np.linspace(0.2, 1.0, 5)
    factor = (np.sinh(beta) - np.sin(beta)) / (np.cosh(beta) + np.cos(beta))
    z = beta[:, None] * x
    shapes = np.cosh(z) - np.cos(z) - factor[:, None] * (np.sinh(z) - np.sin(z))
    return structure(0.32 * (beta / beta[0]) ** 2, 0.008, shapes)


@pytest.fixture(scope="session")
def laboratory_frame() -> KnownStructure:
    """Three storeys, 5 to 21 Hz, 1.5 % damping: the shear frame's closed form."""
    k = np.arange(1, 4)
    angle = (2 * k - 1) * np.pi / 7
    frequencies = 5.0 * np.sin(angle / 2) / np.sin(angle[0] / 2)
    shapes = np.sin(np.outer(angle, [1.0, 2.0, 3.0]))
    return structure(frequencies, 0.015, shapes)
