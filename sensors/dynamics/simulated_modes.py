"""Modes of the structure that is simulated: its damping, and how loads and sensors meet them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.foundation import TurbineError
from sensors.structure.structural_model import StructuralModel


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """Damping of a mode by where its kinetic energy is.

        ζ = ζ_support (1 − b) + ζ_blades b,   b the blades' share of the mode's kinetic energy

    Composite modal damping. The figures stand for a parked turbine: steel, soil and little
    aerodynamics, .7 % in the support structure as in [foundation-updating], 1 % in the blades.
    """

    support: float = 0.007
    """ζ of a mode that lives in tower and monopile [-]."""

    blades: float = 0.010
    """ζ of a mode that lives in the blades [-]."""

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

    frequencies: FloatArray
    """Frequencies, rising, (n_modes,) [Hz]."""

    damping_ratios: FloatArray
    """ζ, (n_modes,) [-]."""

    shapes: FloatArray
    """φ, (n_dofs, n_modes), φᵀ M φ = I."""

    blade_energy_share: FloatArray
    """Blade energy share of the kinetic energy, (n_modes,) [-]."""


def structure_modes(
    model: StructuralModel, damping: ModalDamping, *, highest_frequency: float
) -> StructureModes:
    """Modes of the full model up to a frequency, from M φ = K φ / ω².

    Parameters
    ----------
    model : StructuralModel
        Mass and stiffness.
    damping : ModalDamping
        Of a mode by where its kinetic energy is.
    highest_frequency : float
        Of a mode [Hz].

    Raises
    ------
    TurbineError
        If the structure is unstable: springs too soft for its weight.

    Notes
    -----
    Solved for 1/ω², the lowest modes are the largest eigenvalues and keep eleven digits beside
    axial modes 10⁵ times as high; for ω² they would keep six.
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

    frequencies: FloatArray
    """Undamped frequencies, (n_modes,) [Hz]."""

    damping_ratios: FloatArray
    """ζ, (n_modes,) [-]."""

    participation: FloatArray
    """φᵀ at the loads, (n_modes, n_loads) [kg^-½]."""

    displacement: FloatArray
    """φ along each sensing axis, (n_channels, n_modes) [kg^-½]."""

    rotation: FloatArray
    """ψ = dφ/dz along each sensing axis, (n_channels, n_modes) [rad/(m·kg^½)]."""

    corner_frequencies: FloatArray
    """Corner frequencies, (n_channels,) [Hz]; 0 for a DC-coupled axis."""

    gravity: float
    """g [m/s²]."""


def observed_modes(
    model: StructuralModel, modes: StructureModes, layout: SensorLayout, distribution: FloatArray
) -> ObservedModes:
    """Return the modes as loads excite them and as a layout's accelerometers observe them.

    Parameters
    ----------
    distribution : ndarray, shape (n_dofs, n_loads)
        Forces on the degrees of freedom per unit of each load.

    Raises
    ------
    TurbineError
        For an accelerometer that is not on the tower.
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
