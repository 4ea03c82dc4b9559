"""Figures of a structure that are never known exactly: their nominal values and prior spreads."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np

KNOWN_LEVEL_STD = 0.1  # of a sea level that SCADA reports [m]
UNKNOWN_LEVEL_STD = 1.0  # of one that is not measured: the tide of an open coast [m]


@dataclass(frozen=True, slots=True)
class Figures:
    """One state of knowledge about a turbine; the defaults are the nominal structure.

    Factors multiply the nominal figure of every part that they name.
    """

    youngs_modulus: float = 1.0
    """Factor on E of monopile and tower [-]."""
    wall_thickness: float = 1.0
    """Factor on the wall of monopile and tower, outer diameter kept [-]."""
    density: float = 1.0
    """Factor on the density of monopile and tower [-]."""
    rna_mass: float = 1.0
    """Factor on the masses of nacelle, hub and yaw bearing; not on their moments of inertia [-]."""
    nacelle_roll_inertia: float = 1.0
    """Factor on the nacelle's moment about the x axis through its centre of mass [-]."""
    nacelle_pitch_inertia: float = 1.0
    """Factor on the nacelle's moment about the y axis through its centre of mass [-]."""
    nacelle_yaw_inertia: float = 1.0
    """Factor on the nacelle's moment about the z axis through its centre of mass [-]."""
    blade_mass: float = 1.0
    """Factor on the mass per length of all blades [-]."""
    flap_stiffness: float = 1.0
    """Factor on the flapwise rigidity of all blades [-]."""
    edge_stiffness: float = 1.0
    """Factor on the edgewise rigidity of all blades [-]."""
    added_mass: float = 1.0
    """Coefficient C_a of the water outside that moves along; 1 is nominal [-]."""
    water_level: float = 0.0
    """Sea level above its mean [m]."""
    transition_piece: float = 0.0
    """Point mass at +15 m [kg]."""
    marine_growth: float = 0.0
    """Thickness of the growth between the mudline and the mean sea level [m]."""
    flooded: bool = False
    """Whether water stands inside the monopile, up to the mean sea level."""

    def with_level(self, level: float) -> "Figures":
        """Return the same structure in water of another level above the mean [m]."""
        return replace(self, water_level=level)


SPREADS: Mapping[str, float] = MappingProxyType(
    {
        "youngs_modulus": 0.01,
        "wall_thickness": 0.01,
        "density": 0.01,
        "rna_mass": 0.02,
        "nacelle_roll_inertia": 0.2,
        "nacelle_pitch_inertia": 0.2,
        "nacelle_yaw_inertia": 0.2,
        "blade_mass": 0.02,
        "flap_stiffness": 0.05,
        "edge_stiffness": 0.05,
        "added_mass": 0.15,
        "water_level": KNOWN_LEVEL_STD,
        "transition_piece": 150e3,
        "marine_growth": 0.03,
    }
)
"""Prior standard deviations in the unit of each figure; the scale of a half-normal figure."""

HALF_NORMAL = ("transition_piece", "marine_growth")
"""Figures that are nominally absent and cannot be negative."""


def draw(rng: np.random.Generator, *, level_std: float = KNOWN_LEVEL_STD) -> Figures:
    """Draw every continuous figure from its prior; `flooded` stays as described.

    Parameters
    ----------
    rng : Generator
        Source of randomness; figures are drawn in the order of their fields.
    level_std : float
        Standard deviation of the sea level [m].

    Returns
    -------
    Figures
        Normal about the nominal value, half-normal for those of `HALF_NORMAL`.
    """
    nominal, drawn = Figures(), {}
    for figure in fields(Figures):
        if figure.name not in SPREADS:
            continue
        spread = level_std if figure.name == "water_level" else SPREADS[figure.name]
        offset = spread * rng.standard_normal()
        drawn[figure.name] = getattr(nominal, figure.name) + (
            abs(offset) if figure.name in HALF_NORMAL else offset
        )
    return replace(nominal, **drawn)
