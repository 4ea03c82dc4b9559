"""Key figures of a structure's description: heights, masses, first modes (`pilewatch describe`)."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.full_model_modes import FullModes, full_modes
from sensors.structure.description import Direction, TurbineDescription

N_MODES = 12  # of a turbine with blades, whose own lie between, the second bending modes too
STILL = 1e-6  # of the largest motion of any mode: below it the tower does not sway [-]
POINTS = 60  # of the tower at which its shapes are computed
HIGHEST_DESCRIBED = 12.5  # of the modes [Hz]


@dataclass(frozen=True, slots=True, eq=False)
class StructureFigures:
    """Key figures of a description, to check it against the intended structure."""

    description: TurbineDescription
    elevations: FloatArray
    """Elevations of the shapes, shape (n,) [m]."""
    modes: FullModes
    """Modes at the description's springs; shapes: fore-aft × n, then side-side × n."""

    @property
    def tube_mass(self) -> float:
        """Mass of monopile and tower above the mudline [kg]."""
        return sum(tube.mass_per_length * tube.length for tube in self.description.tubes)

    @property
    def top_mass(self) -> float:
        """Mass of nacelle, hub and other bodies on the tower's top, without blades [kg]."""
        return self.description.rotor_nacelle.mass

    @property
    def blade_mass(self) -> float:
        """Mass of all blades [kg]."""
        blades = self.description.blades
        return 0.0 if blades is None else blades.mass

    @property
    def water_depth(self) -> float:
        """Depth from the mudline to the water's level; 0 without water [m]."""
        water = self.description.water
        return 0.0 if water is None else max(0.0, water.level - self.description.mudline)

    @property
    def first(self) -> list[tuple[float, Direction | Literal["torsion"], float]]:
        """Frequency [Hz], direction and blade energy share [-] of the first modes.

        A mode in which the tower stays where it is turns it about its axis.
        """
        modes = self.modes
        still = modes.sensor_motion < STILL * modes.sensor_motion.max()
        rows = zip(
            modes.frequencies, modes.directions, modes.blade_energy_share, still, strict=True
        )
        return [
            (float(f), "torsion" if is_still else direction, float(share))
            for f, direction, share, is_still in rows
        ][:N_MODES]

    def shape(self, mode: int) -> FloatArray:
        """Return the tower's shape in the mode's direction, shape (n,), largest component 1 [-]."""
        fore_aft, side_side = np.split(self.modes.shapes[mode].real, 2)
        return fore_aft if self.modes.directions[mode] == "FA" else side_side

    def rows(self) -> list[tuple[str, str]]:
        """Return names and figures with their units."""
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
            ("inertia of the nacelle", self._inertia),
            ("mass of the blades", f"{self.blade_mass / 1e3:,.0f} t"),
            ("rotor radius", f"{length:g} m"),
            ("k11, k22, k12", f"{k11:.4g} N/m, {k22:.4g} N·m/rad, {k12:.4g} N/rad"),
            ("sign of k12", described.foundation.sign),
            ("moving mass below the mudline", self._moving_mass),
        ]

    @property
    def _inertia(self) -> str:
        top = self.description.rotor_nacelle
        if top.has_inertia:
            return "stated"
        return "none stated: a point mass" if top.mass else "none"

    @property
    def _moving_mass(self) -> str:
        stated, lowest = self.description.foundation.moving_mass, self.description.tubes[0]
        if stated is not None:
            return f"{stated / 1e3:,.3g} t/m"
        return f"none stated; the lowest tube's steel has {lowest.mass_per_length / 1e3:,.3g} t/m"

    def as_json(self) -> dict[str, Any]:
        """Return the entries of `describe --json`."""
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
            "moving_mass_kg_per_m": self.description.foundation.moving_mass,
            "modes": [
                {"frequency_hz": f, "direction": direction, "blade_energy_share": share}
                for f, direction, share in self.first
            ],
        }


def structure_figures(description: TurbineDescription) -> StructureFigures:
    """Return key figures and first modes of a description.

    Raises
    ------
    TurbineError
        If the springs are not positive definite or the structure would fall.
    """
    bottom, top = description.mudline, description.tower_top
    elevations = np.linspace(bottom, top, POINTS + 1)[1:]
    layout = biaxial_layout(
        "description", turbine=description.name, unit="tower", elevations=tuple(elevations.tolist())
    )
    modes = full_modes(description, layout, highest_frequency=HIGHEST_DESCRIBED)
    return StructureFigures(description, elevations, modes)


def _largest_step(widths: list[float]) -> float:
    return max((abs(upper - lower) for lower, upper in pairwise(widths)), default=0.0)
