"""Response of a structure with any damping, which may change with time, and what is read of it.

Exact for forces that run straight from sample to sample, like `modal_response`.
"""

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.dynamics.damped_modes import DampedSystem
from sensors.structure.ac_coupling import ChannelCoupling


class DampedResponse:
    """From forces to readings like `AccelerationResponse`, for a `DampedSystem` that may change.

    Each pole is one exact complex recursion. When the structure changes, displacement and
    velocity of every degree of freedom go on; what the new modes cannot hold of them is lost.
    """

    def __init__(self, system: DampedSystem, sampling_rate: float) -> None:
        self._rate = sampling_rate
        self._state = np.zeros(len(system.poles), dtype=np.complex128)  # z at the last step
        self._force = np.zeros(system.modes.participation.shape[1])  # at the last step [N]
        self._states = np.zeros((len(system.poles), 0), dtype=np.complex128)  # z of `advance`
        self._adopt(system)
        self._coupling = ChannelCoupling(system.modes.corner_frequencies, sampling_rate)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return len(self._system.modes.corner_frequencies)

    @property
    def system(self) -> DampedSystem:
        """The structure as it is now."""
        return self._system

    def _adopt(self, system: DampedSystem) -> None:
        """Filter coefficients and outputs of a system."""
        step = system.poles / self._rate
        self._system = system
        self._propagator = np.exp(step)
        scale = self._rate / system.poles**2
        self._gamma_0 = (step * self._propagator - self._propagator + 1.0) * scale
        self._gamma_1 = (self._propagator - 1.0 - step) * scale
        modes = system.modes
        self._input = system.vectors.T @ modes.participation  # φᵀ p per unit load
        self._input_parts = np.concatenate([self._input.real, self._input.imag])
        self._output = 2.0 * (
            (modes.displacement @ system.vectors) * system.poles**2
            - modes.gravity * (modes.rotation @ system.vectors)
        )
        self._direct = modes.displacement @ modes.participation

    def change(self, system: DampedSystem) -> None:
        """Go on with another structure: the same degrees of freedom and loads."""
        old = self._system
        q = 2.0 * (old.vectors @ self._state).real
        velocity = 2.0 * ((old.vectors * old.poles) @ self._state).real
        carry = system.shapes.T @ system.mass @ old.shapes
        q, velocity = carry @ q, carry @ velocity
        # Laplace transform of the free motion: z = φᵀ (λ q + C q + q')
        self._state = system.vectors.T @ (system.damping @ q + velocity)
        self._state += system.poles * (system.vectors.T @ q)
        self._adopt(system)

    def advance(self, forces: FloatArray) -> FloatArray:
        """Accelerometer readings at the next samples.

        Parameters
        ----------
        forces : ndarray, shape (n_samples, n_loads)
            Forces [N].

        Returns
        -------
        ndarray, shape (n_samples, n_channels)
            [m/s²].
        """
        from scipy.signal import lfilter  # 75 MB that only a simulation needs

        n_modes = len(self._state)
        parts = self._input_parts @ forces.T  # real times real, half the work of complex times real
        driven = np.empty((n_modes, len(forces)), dtype=np.complex128)
        driven.real, driven.imag = parts[:n_modes], parts[n_modes:]
        before = self._input @ self._force
        memory = self._gamma_0 * before + self._propagator * self._state
        for mode, force in enumerate(driven):
            taps = np.array([self._gamma_1[mode], self._gamma_0[mode]])
            poles = np.array([1.0, -self._propagator[mode]])
            driven[mode], _ = lfilter(taps, poles, force, zi=memory[mode : mode + 1])
        self._states = driven
        self._state = driven[:, -1].copy()
        self._force = forces[-1].copy()
        readings = np.ascontiguousarray((self._output @ driven).real)
        readings += self._direct @ forces.T
        self._coupling.advance(readings)
        return readings.T

    def displacements(self, rows: FloatArray) -> FloatArray:
        """Of any points of the structure over the last `advance`, (n_rows, n_samples) [m].

        Parameters
        ----------
        rows : ndarray, shape (n_rows, n_dofs)
            Displacement by degree of freedom.

        Returns
        -------
        ndarray, shape (n_rows, n_samples)
            In [m].
        """
        seen = 2.0 * (rows @ self._system.shapes) @ self._system.vectors
        motion: FloatArray = (seen @ self._states).real
        return motion

    def gains(self, frequencies: FloatArray) -> ComplexArray:
        """Reading per unit of each harmonic load, (n_frequencies, n_channels, n_loads)."""
        delay = np.exp(-2j * np.pi * frequencies / self._rate)[:, None]
        response = self._direct.astype(np.complex128)
        for conjugate in (False, True):
            fields = (self._gamma_1, self._gamma_0, self._propagator, self._output, self._input)
            g1, g0, e, output, driven = (f.conj() if conjugate else f for f in fields)
            filtered = (g1 + g0 * delay) / (1.0 - e * delay)  # (n_frequencies, n_modes)
            response = response + 0.5 * (output * filtered[:, None, :]) @ driven
        return response * self._coupling.gain(frequencies)
