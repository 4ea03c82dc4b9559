"""What a structure's description comes to: heights, masses, first modes. `pilewatch describe`."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.full_model_modes import FullModes, full_modes
from sensors.structure.description import Direction, TurbineDescription

N_MODES = 6
POINTS = 60  # of the tower, at which its shapes are known
HIGHEST_FREQUENCY = 12.5  # up to which modes are looked for [Hz]


@dataclass(frozen=True, slots=True, eq=False)
class StructureFigures:
    """Key figures of a description, to see whether it is the structure that was meant."""

    description: TurbineDescription
    elevations: FloatArray  # where the shapes are known, (n,) [m]
    modes: FullModes  # at the description's springs; shapes: fore-aft × n, then side-side × n

    @property
    def tube_mass(self) -> float:
        """Of monopile and tower above the mudline [kg]."""
        return sum(tube.mass_per_length * tube.length for tube in self.description.tubes)

    @property
    def top_mass(self) -> float:
        """Of nacelle, hub and everything that moves with the tower's top but the blades [kg]."""
        top = self.description.rotor_nacelle
        return top.hub_mass + sum(body.mass for body in top.bodies)

    @property
    def blade_mass(self) -> float:
        """Of all blades [kg]."""
        blades = self.description.blades
        if blades is None:
            return 0.0
        return blades.number * sum(part.mass_per_length * part.length for part in blades.elements)

    @property
    def water_depth(self) -> float:
        """From the mudline to the water's level; 0 without water [m]."""
        water = self.description.water
        return 0.0 if water is None else max(0.0, water.level - self.description.mudline)

    @property
    def first(self) -> list[tuple[float, Direction, float]]:
        """Frequency [Hz], direction and blade energy share [-] of the first modes."""
        modes = self.modes
        rows = zip(modes.frequencies, modes.directions, modes.blade_energy_share, strict=True)
        return [(float(f), direction, float(share)) for f, direction, share in rows][:N_MODES]

    def shape(self, mode: int) -> FloatArray:
        """Of the tower in the mode's own direction, (n,), largest 1 [-]."""
        fore_aft, side_side = np.split(self.modes.shapes[mode].real, 2)
        return fore_aft if self.modes.directions[mode] == "FA" else side_side

    def rows(self) -> list[tuple[str, str]]:
        """What a person reads first: names and figures with their units."""
        described = self.description
        k11, k22, k12 = described.nominal
        rotor = described.blades
        length = 0.0 if rotor is None else rotor.elements[-1].outer + rotor.hub_radius
        widths = [tube.diameter for tube in described.tubes]
        return [
            ("from mudline to tower top", f"{described.mudline:g} to {described.tower_top:g} m"),
            ("tubes", f"{min(widths):g} to {max(widths):g} m wide, in {len(widths)} elements"),
            ("largest step of the diameter", f"{_largest_step(widths):.2f} m"),
            ("water depth", f"{self.water_depth:g} m"),
            ("mass of the tubes", f"{self.tube_mass / 1e3:,.0f} t"),
            ("mass on the top, without blades", f"{self.top_mass / 1e3:,.0f} t"),
            ("mass of the blades", f"{self.blade_mass / 1e3:,.0f} t"),
            ("rotor radius", f"{length:g} m"),
            ("k11, k22, k12", f"{k11:.4g} N/m, {k22:.4g} Nm/rad, {k12:.4g} N/rad"),
            ("sign of k12", described.foundation.sign),
        ]

    def as_json(self) -> dict[str, Any]:
        """The entries of `describe --json`."""
        k11, k22, k12 = map(float, self.description.nominal)
        return {
            "name": self.description.name,
            "mudline_m": self.description.mudline,
            "tower_top_m": self.description.tower_top,
            "water_depth_m": self.water_depth,
            "tube_mass_kg": self.tube_mass,
            "top_mass_kg": self.top_mass,
            "blade_mass_kg": self.blade_mass,
            "k11_n_per_m": k11,
            "k22_nm_per_rad": k22,
            "k12_n_per_rad": k12,
            "modes": [
                {"frequency_hz": f, "direction": direction, "blade_energy_share": share}
                for f, direction, share in self.first
            ],
        }


def structure_figures(description: TurbineDescription) -> StructureFigures:
    """Key figures and first modes of a description.

    Raises TurbineError where the springs are not positive definite or the structure would fall.
    """
    bottom, top = description.mudline, description.tower_top
    elevations = np.linspace(bottom, top, POINTS + 1)[1:]
    layout = biaxial_layout(
        "description", turbine=description.name, unit="tower", elevations=tuple(elevations.tolist())
    )
    modes = full_modes(description, layout, highest_frequency=HIGHEST_FREQUENCY)
    return StructureFigures(description, elevations, modes)


def _largest_step(widths: list[float]) -> float:
    return max((abs(upper - lower) for lower, upper in pairwise(widths)), default=0.0)
