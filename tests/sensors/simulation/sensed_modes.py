"""The modes of a simulated tower as its instruments sense them: the truth of an identification."""

from dataclasses import dataclass

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.simulation.instruments import MountedAxes
from sensors.simulation.tower import SimulatedTower


@dataclass(frozen=True, slots=True, eq=False)
class SensedModes:
    """The simulated structure's modes in free motion, as the accelerometers read them."""

    frequencies: FloatArray
    """|λ| / 2π, rising, (n_modes,) [Hz]."""

    damping_ratios: FloatArray
    """ζ, (n_modes,) [-]."""

    shapes: ComplexArray
    """φ, (n_modes, n_channels), of any scale and phase."""


def sensed_modes(tower: SimulatedTower) -> SensedModes:
    """Return every mode at the first sample, with the air's damping and the axes as mounted."""
    system, shapes = tower.system, tower.system.readings
    misalignment = tower.settings.instruments.misalignment
    if tower.schedule.yaws or misalignment:
        axes = MountedAxes(tower.layout, misalignment)
        yaw = np.full(len(shapes), tower.schedule.figure("yaw", 0.0))
        real, imaginary = (axes.readings(part, yaw) for part in (shapes.real, shapes.imag))
        shapes = real + 1j * imaginary
    return SensedModes(system.frequencies, system.damping_ratios, shapes)
