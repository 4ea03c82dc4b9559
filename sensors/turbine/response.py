"""Response of the structure to nodal forces, integrated exactly in modal state space, and what
accelerometers on it read.

Every retained mode obeys, with q in mass-normalised coordinates [kg^½·m],

    q'' + 2 ζ ω q' + ω² q = p(t),   p = φᵀ f(t)  [N/kg^½]

The forces are given at the sampling instants and run straight from one to the next (first-order
hold). For such a force the recursion used here has no integration error whatever the time step:
it is the matrix exponential, not a difference scheme. Series come in chunks of any length and the
state is carried, so memory does not grow with the duration.

Where dampers couple the modes (air, a turning rotor) or the structure changes with time (scour, a
tide), the same is done with the complex modes of the damped system: `DampedResponse`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm
from scipy.signal import lfilter

from sensors.layout import SensorLayout
from sensors.turbine.assembly import StructuralModel
from sensors.turbine.foundation import TurbineError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """Damping of a mode by where its kinetic energy is.

        ζ = ζ_support (1 − b) + ζ_blades b,   b the blades' share of the mode's kinetic energy

    Composite modal damping. The figures stand for a parked turbine: steel, soil and little
    aerodynamics, .7 % in the support structure as in [foundation-updating], 1 % in the blades.
    """

    support: float = 0.007  # ζ of a mode that lives in tower and monopile [-]
    blades: float = 0.010  # ζ of a mode that lives in the blades [-]

    def __post_init__(self) -> None:
        for name, ratio in (("support", self.support), ("blades", self.blades)):
            if not 0.0 < ratio < 1.0:
                raise TurbineError(
                    f"damping {name} is {ratio:g}; a ratio to critical damping is needed, "
                    "above 0 and below 1"
                )


@dataclass(frozen=True, slots=True, eq=False)
class StructureModes:
    """Undamped modes of the full model, mass-normalised, and the damping given to them."""

    frequencies: FloatArray  # rising, (n_modes,) [Hz]
    damping_ratios: FloatArray  # ζ, (n_modes,) [-]
    shapes: FloatArray  # φ, (n_dofs, n_modes), φᵀ M φ = I
    blade_energy_share: FloatArray  # of the kinetic energy, (n_modes,) [-]


def structure_modes(
    model: StructuralModel, damping: ModalDamping, *, highest_frequency: float
) -> StructureModes:
    """Modes of the full model up to a frequency [Hz], from M φ = K φ / ω².

    Solved for 1/ω², the lowest modes are the largest eigenvalues and keep eleven digits beside
    axial modes 10⁵ times as high; for ω² they would keep six.

    Raises TurbineError where the structure is unstable: springs too soft for its weight.
    """
    try:
        flexibilities, vectors = eigh(
            model.mass,
            model.stiffness,
            subset_by_value=((2.0 * np.pi * highest_frequency) ** -2, np.inf),
        )
    except np.linalg.LinAlgError as error:
        raise TurbineError(
            f"springs k11, k22, k12 = {', '.join(f'{k:.4g}' for k in model.theta)}: "
            f"{model.description.name} is unstable under its own weight; stiffer ones are needed"
        ) from error
    omega = flexibilities[::-1] ** -0.5
    shapes = vectors[:, ::-1] * omega  # from φᵀ K φ = 1 to φᵀ M φ = 1
    share = np.einsum("im,ij,jm->m", shapes, model.blade_mass, shapes, optimize=True)
    return StructureModes(
        frequencies=omega / (2.0 * np.pi),
        damping_ratios=damping.support + (damping.blades - damping.support) * share,
        shapes=shapes,
        blade_energy_share=share,
    )


@dataclass(frozen=True, slots=True, eq=False)
class ObservedModes:
    """Modes of the structure as a set of loads excites them and a sensor layout observes them."""

    frequencies: FloatArray  # undamped, (n_modes,) [Hz]
    damping_ratios: FloatArray  # ζ, (n_modes,) [-]
    participation: FloatArray  # φᵀ at the loads, (n_modes, n_loads) [kg^-½]
    displacement: FloatArray  # φ along each sensing axis, (n_channels, n_modes) [kg^-½]
    rotation: FloatArray  # ψ = dφ/dz along each sensing axis, (n_channels, n_modes) [rad/(m·kg^½)]
    corner_frequencies: FloatArray  # (n_channels,) [Hz]; 0 for a DC-coupled axis
    gravity: float  # g [m/s²]


def observed_modes(
    model: StructuralModel, modes: StructureModes, layout: SensorLayout, distribution: FloatArray
) -> ObservedModes:
    """The modes as loads excite them and as a layout's accelerometers observe them.

    distribution   forces on the degrees of freedom per unit of each load, (n_dofs, n_loads)

    Raises TurbineError for an accelerometer that is not on the tower.
    """
    axes = layout.channels
    displacement = [model.tower_displacement(axis.elevation, axis.direction) for axis in axes]
    slope = [model.tower_slope(axis.elevation, axis.direction) for axis in axes]
    corners = [axis.corner_frequency if axis.coupling == "ac" else 0.0 for axis in axes]
    return ObservedModes(
        frequencies=modes.frequencies,
        damping_ratios=modes.damping_ratios,
        participation=modes.shapes.T @ distribution,
        displacement=np.array(displacement) @ modes.shapes,
        rotation=np.array(slope) @ modes.shapes,
        corner_frequencies=np.array(corners),
        gravity=model.description.gravity,
    )


class ModalOscillators:
    """The modes' equations of motion as one exact recursion, mode by mode.

    With x = (q, q')ᵀ and a force linear between its samples,

        x_{k+1} = Φ x_k + Γ0 p_k + Γ1 p_{k+1}

    Each mode then is a filter with two poles, w_k = p_k + tr(Φ) w_{k-1} − det(Φ) w_{k-2}, and q,
    q', q'' are three-tap sums of w: `displacement_taps`, `velocity_taps`, `acceleration_taps`,
    each (n_modes, 3), so that q_k = Σ_i taps_i w_{k-i}.
    """

    def __init__(
        self, frequencies: FloatArray, damping_ratios: FloatArray, sampling_rate: float
    ) -> None:
        self._dt = 1.0 / sampling_rate
        omega = 2.0 * np.pi * frequencies
        propagator, gamma_0, gamma_1 = first_order_hold(omega, damping_ratios, self._dt)
        trace = np.trace(propagator, axis1=1, axis2=2)
        determinant = np.linalg.det(propagator)
        self._denominator = np.stack([np.ones_like(trace), -trace, determinant], axis=1)
        state_taps = _state_taps(propagator, trace, gamma_0, gamma_1)
        self.displacement_taps = state_taps[:, 0]
        self.velocity_taps = state_taps[:, 1]
        self.acceleration_taps = (  # q'' = p − 2 ζ ω q' − ω² q
            self._denominator
            - (2.0 * damping_ratios * omega)[:, None] * self.velocity_taps
            - (omega**2)[:, None] * self.displacement_taps
        )
        self._memory = np.zeros((len(omega), 2))  # lfilter's state
        self._tail = np.zeros((len(omega), 2))  # w at the two last samples

    def advance(self, modal_forces: FloatArray) -> FloatArray:
        """Filtered forces w of the next samples, preceded by the two before them.

        modal_forces   p, (n_modes, n_samples) [N/kg^½]
        returns        w, (n_modes, 2 + n_samples)
        """
        filtered = np.empty((len(modal_forces), modal_forces.shape[1] + 2))
        filtered[:, :2] = self._tail
        one = np.ones(1)
        for mode, force in enumerate(modal_forces):
            filtered[mode, 2:], self._memory[mode] = lfilter(
                one, self._denominator[mode], force, zi=self._memory[mode]
            )
        self._tail = filtered[:, -2:].copy()
        return filtered

    def frequency_response(self, taps: FloatArray, frequencies: FloatArray) -> ComplexArray:
        """Response per unit harmonic force sampled as above: Σ taps_i z⁻ⁱ / Σ den_i z⁻ⁱ.

        taps          (..., n_modes, 3)
        frequencies   (n_frequencies,) [Hz]
        returns       (n_frequencies, ..., n_modes)
        """
        powers = np.exp(
            -2j * np.pi * self._dt * np.multiply.outer(frequencies, np.arange(3))
        )  # z⁻ⁱ, (n_frequencies, 3)
        numerator = np.tensordot(powers, taps, axes=([1], [taps.ndim - 1]))
        denominator = powers @ self._denominator.T
        between = tuple(range(1, numerator.ndim - 1))
        return numerator / np.expand_dims(denominator, between)


def first_order_hold(
    omega: FloatArray, damping_ratios: FloatArray, time_step: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Exact propagators of damped oscillators under a force linear between samples.

    omega            undamped circular frequencies, (n_modes,) [rad/s]
    damping_ratios   ζ, (n_modes,) [-]
    time_step        T [s]
    returns          Φ (n_modes, 2, 2), Γ0 (n_modes, 2), Γ1 (n_modes, 2) for x = (q, q')ᵀ

    All three are blocks of one matrix exponential, exp([[A T, b T, 0], [0, 0, 1], [0, 0, 0]]):
    Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems (triangle hold).
    Time is counted in steps inside, so that q and q' T are of the same size.
    """
    step = omega * time_step
    augmented = np.zeros((len(omega), 4, 4))
    augmented[:, 0, 1] = 1.0
    augmented[:, 1, 0] = -(step**2)
    augmented[:, 1, 1] = -2.0 * damping_ratios * step
    augmented[:, 1, 2] = time_step**2
    augmented[:, 2, 3] = 1.0
    exponential = expm(augmented)
    to_seconds = np.array([1.0, 1.0 / time_step])
    propagator = exponential[:, :2, :2] * np.outer(to_seconds, 1.0 / to_seconds)
    gamma_1 = exponential[:, :2, 3] * to_seconds
    gamma_0 = exponential[:, :2, 2] * to_seconds - gamma_1
    return propagator, gamma_0, gamma_1


def _state_taps(
    propagator: FloatArray, trace: FloatArray, gamma_0: FloatArray, gamma_1: FloatArray
) -> FloatArray:
    """Numerators of q and q' over the modes' common denominator, (n_modes, 2, 3).

    (zI − Φ)⁻¹ (Γ1 z + Γ0) with adj(zI − Φ) = zI − R, R = tr(Φ) I − Φ.
    """
    remainder = trace[:, None, None] * np.eye(2) - propagator
    return np.stack(
        [
            gamma_1,
            gamma_0 - np.einsum("mij,mj->mi", remainder, gamma_1),
            -np.einsum("mij,mj->mi", remainder, gamma_0),
        ],
        axis=2,
    )


class AccelerationResponse:
    """From forces to what the accelerometers read, chunk by chunk; starts at rest.

    A DC-coupled axis reads u'' − g·ψ: it tilts with the tower by ψ = du/dz and feels gravity's
    component. An AC-coupled one reads the same through its high-pass, s / (s + 2π f_corner).
    """

    def __init__(self, modes: ObservedModes, sampling_rate: float) -> None:
        self._modes = modes
        self._sampling_rate = sampling_rate
        self._oscillators = ModalOscillators(modes.frequencies, modes.damping_ratios, sampling_rate)
        self._taps = (  # (n_channels, n_modes, 3)
            modes.displacement[:, :, None] * self._oscillators.acceleration_taps
            - modes.gravity * modes.rotation[:, :, None] * self._oscillators.displacement_taps
        )
        self._coupling = _high_pass(modes.corner_frequencies, sampling_rate)
        self._coupling_memory = np.zeros((len(modes.corner_frequencies), 1))

    @property
    def n_channels(self) -> int:
        return len(self._modes.corner_frequencies)

    def advance(self, forces: FloatArray) -> FloatArray:
        """Accelerometer readings at the next samples.

        forces    (n_samples, n_loads) [N]
        returns   (n_samples, n_channels) [m/s²]
        """
        filtered = self._oscillators.advance(self._modes.participation @ forces.T)
        readings = (
            self._taps[:, :, 0] @ filtered[:, 2:]
            + self._taps[:, :, 1] @ filtered[:, 1:-1]
            + self._taps[:, :, 2] @ filtered[:, :-2]
        )
        for channel in np.flatnonzero(self._modes.corner_frequencies):
            numerator, denominator = self._coupling[channel]
            readings[channel], self._coupling_memory[channel] = lfilter(
                numerator, denominator, readings[channel], zi=self._coupling_memory[channel]
            )
        return readings.T

    def gains(self, frequencies: FloatArray) -> ComplexArray:
        """Reading per unit of each harmonic load, (n_frequencies, n_channels, n_loads)."""
        return self.frequency_response(frequencies) @ self._modes.participation

    def frequency_response(self, frequencies: FloatArray) -> ComplexArray:
        """Reading per unit modal force, (n_frequencies, n_channels, n_modes) [m/s² per N/kg^½].

        Exact for the sampled series, not only for the continuous structure: what `advance` does.
        """
        response = self._oscillators.frequency_response(self._taps, frequencies)
        return response * _coupling_gain(self._coupling, frequencies / self._sampling_rate)


def _coupling_gain(coupling: FloatArray, cycles: FloatArray) -> ComplexArray:
    """Response of each channel's high-pass, (n_frequencies, n_channels, 1).

    cycles   frequencies over the sampling rate, (n_frequencies,) [-]
    """
    delay = np.exp(-2j * np.pi * cycles)
    numerator, denominator = coupling[:, 0], coupling[:, 1]
    gain = (numerator[:, :1] + numerator[:, 1:] * delay) / (
        denominator[:, :1] + denominator[:, 1:] * delay
    )  # (n_channels, n_frequencies)
    return gain.T[:, :, None]


def _high_pass(corner_frequencies: FloatArray, sampling_rate: float) -> FloatArray:
    """First-order high-pass of each channel by the bilinear transform, (n_channels, 2, 2).

    [channel, 0] is the numerator, [channel, 1] the denominator; a corner of 0 passes everything.
    """
    corner = np.tan(np.pi * corner_frequencies / sampling_rate)  # prewarped
    passing = corner == 0.0
    numerator = np.stack([np.ones_like(corner), np.where(passing, 0.0, -1.0)], axis=1)
    denominator = np.stack([1.0 + corner, np.where(passing, 0.0, corner - 1.0)], axis=1)
    return np.stack([numerator, denominator], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class DampedSystem:
    """Complex modes of a structure with any viscous damping, and what they are read by.

    With the undamped modes' coordinates q (mass 1, stiffness ω², damping C) each pole λ above the
    real axis has a shape φ, scaled so that φᵀ (2λ I + C) φ = 1, and

        z' = λ z + φᵀ p(t),   q = 2 Re Σ φ z,   q'' = p + 2 Re Σ λ² φ z
    """

    poles: ComplexArray  # λ, (n_modes,) [rad/s]
    vectors: ComplexArray  # φ in the columns, (n_modes, n_modes)
    damping: FloatArray  # C, (n_modes, n_modes) [1/s]
    modes: ObservedModes
    shapes: FloatArray  # undamped modes, (n_dofs, n_modes)
    mass: FloatArray  # M, (n_dofs, n_dofs)

    @property
    def frequencies(self) -> FloatArray:
        """|λ| / 2π, (n_modes,) [Hz]."""
        return np.abs(self.poles) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> FloatArray:
        """−Re λ / |λ|, (n_modes,) [-]."""
        return -self.poles.real / np.abs(self.poles)


def damped_system(
    model: StructuralModel,
    modes: StructureModes,
    observed: ObservedModes,
    dampers: FloatArray | None = None,
) -> DampedSystem:
    """The modes with their modal damping and with dampers between the degrees of freedom.

    dampers   added to the modal damping, (n_dofs, n_dofs) [N·s/m]; None: none, shapes stay real

    Raises TurbineError where a mode is overdamped.
    """
    omega = 2.0 * np.pi * modes.frequencies
    damping = np.diag(2.0 * modes.damping_ratios * omega)
    if dampers is None:
        poles = omega * (-modes.damping_ratios + 1j * np.sqrt(1.0 - modes.damping_ratios**2))
        vectors = np.eye(len(omega), dtype=np.complex128)
    else:
        damping = damping + modes.shapes.T @ dampers @ modes.shapes
        poles, vectors = _complex_modes(omega, damping)
    scale = np.einsum("im,ij,jm->m", vectors, damping, vectors, optimize=True)
    scale += 2.0 * poles * np.einsum("im,im->m", vectors, vectors)
    return DampedSystem(
        poles, vectors / np.sqrt(scale), damping, observed, modes.shapes, model.mass
    )


def _complex_modes(omega: FloatArray, damping: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Poles above the real axis, lowest first, and their shapes in the undamped coordinates."""
    n = len(omega)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -damping]])
    poles, vectors = np.linalg.eig(state)
    upper = np.flatnonzero(poles.imag > 0)
    if len(upper) < n:
        raise TurbineError(
            f"{n - len(upper)} modes are overdamped: dampers are too strong for an oscillation"
        )
    upper = upper[np.argsort(np.abs(poles[upper]))]
    return poles[upper], vectors[:n, upper]


class DampedResponse:
    """From forces to readings like `AccelerationResponse`, for a `DampedSystem` that may change.

    Each pole is one exact complex recursion. When the structure changes, displacement and
    velocity of every degree of freedom go on; what the new modes cannot hold of them is lost.
    """

    def __init__(self, system: DampedSystem, sampling_rate: float) -> None:
        self._rate = sampling_rate
        self._state = np.zeros(len(system.poles), dtype=np.complex128)  # z at the last step
        self._force = np.zeros(system.modes.participation.shape[1])  # at the last step [N]
        self._course = np.zeros((len(system.poles), 0), dtype=np.complex128)  # z of `advance`
        self._adopt(system)
        corners = system.modes.corner_frequencies
        self._coupling = _high_pass(corners, sampling_rate)
        self._coupling_memory = np.zeros((len(corners), 1))

    @property
    def n_channels(self) -> int:
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

        forces    (n_samples, n_loads) [N]
        returns   (n_samples, n_channels) [m/s²]
        """
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
        self._course = driven
        self._state = driven[:, -1].copy()
        self._force = forces[-1].copy()
        readings = np.ascontiguousarray((self._output @ driven).real)
        readings += self._direct @ forces.T
        for channel in np.flatnonzero(self._system.modes.corner_frequencies):
            numerator, denominator = self._coupling[channel]
            readings[channel], self._coupling_memory[channel] = lfilter(
                numerator, denominator, readings[channel], zi=self._coupling_memory[channel]
            )
        return readings.T

    def displacements(self, rows: FloatArray) -> FloatArray:
        """Of any points of the structure over the last `advance`, (n_rows, n_samples) [m].

        rows   displacement by degree of freedom, (n_rows, n_dofs)
        """
        seen = 2.0 * (rows @ self._system.shapes) @ self._system.vectors
        motion: FloatArray = (seen @ self._course).real
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
        return response * _coupling_gain(self._coupling, frequencies / self._rate)
