"""Response to nodal forces, integrated exactly in modal state space, as accelerometers read it.

Every retained mode obeys, with q in mass-normalised coordinates [kg^½·m],

    q'' + 2 ζ ω q' + ω² q = p(t),   p = φᵀ f(t)  [N/kg^½]

The forces are given at the sampling instants and run straight from one to the next (first-order
hold). For such a force the recursion used here has no integration error whatever the time step:
it is the matrix exponential, not a difference scheme. Series come in chunks of any length and the
state is carried, so memory does not grow with the duration.

Where dampers couple the modes (air, a turning rotor) or the structure changes with time (scour, a
tide), `damped_response` does the same with the complex modes of the damped system.
"""

from sensors.arrays import ComplexArray, FloatArray
from sensors.dynamics.responses.oscillators import ModalOscillators
from sensors.dynamics.simulated_modes import ObservedModes
from sensors.structure.ac_coupling import ChannelCoupling


class AccelerationResponse:
    """From forces to what the accelerometers read, chunk by chunk; starts at rest.

    A DC-coupled axis reads u'' − g·ψ: it tilts with the tower by ψ = du/dz and feels gravity's
    component. An AC-coupled one reads the same through its high-pass, s / (s + 2π f_corner).
    """

    def __init__(self, modes: ObservedModes, sampling_rate: float) -> None:
        self._modes = modes
        self._oscillators = ModalOscillators(modes.frequencies, modes.damping_ratios, sampling_rate)
        self._taps = (  # (n_channels, n_modes, 3)
            modes.displacement[:, :, None] * self._oscillators.acceleration_taps
            - modes.gravity * modes.rotation[:, :, None] * self._oscillators.displacement_taps
        )
        self._coupling = ChannelCoupling(modes.corner_frequencies, sampling_rate)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return len(self._modes.corner_frequencies)

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
        filtered = self._oscillators.advance(self._modes.participation @ forces.T)
        readings = (
            self._taps[:, :, 0] @ filtered[:, 2:]
            + self._taps[:, :, 1] @ filtered[:, 1:-1]
            + self._taps[:, :, 2] @ filtered[:, :-2]
        )
        self._coupling.advance(readings)
        return readings.T

    def gains(self, frequencies: FloatArray) -> ComplexArray:
        """Reading per unit of each harmonic load, (n_frequencies, n_channels, n_loads)."""
        return self.frequency_response(frequencies) @ self._modes.participation

    def frequency_response(self, frequencies: FloatArray) -> ComplexArray:
        """Reading per unit modal force, (n_frequencies, n_channels, n_modes) [m/s² per N/kg^½].

        Exact for the sampled series, not only for the continuous structure: what `advance` does.
        """
        response = self._oscillators.frequency_response(self._taps, frequencies)
        return response * self._coupling.gain(frequencies)
