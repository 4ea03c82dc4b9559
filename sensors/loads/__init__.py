"""What acts on the structure: spectra, the series drawn from them, and where they act.

broadband.py   white load on every node, and one with a sea's spectrum, of a stated rms
waves.py       a JONSWAP sea and Morison's equation, up to the instantaneous surface
wind.py        Kaimal turbulence, drag on tower, nacelle and feathered blades, damping by air
rotor.py       what a turning rotor adds: thrust, its damping, harmonics of its speed
spectra.py     the formulas
filtered.py    white noise through a filter
synthesis.py   Gaussian series of any cross-spectrum

All are drawn without end at constant memory, from generators of their own.
"""

from sensors.loads.broadband import (
    BroadbandLoad,
    WaveBandLoad,
    blade_pattern,
    random_loads,
    tower_pattern,
    wave_kernel,
    wave_pattern,
    wave_profile,
)
from sensors.loads.filtered import FilteredNoise, RandomLoad, spectral_kernel, white_kernel
from sensors.loads.load import Load, LoadError, RandomStream, generator
from sensors.loads.rotor import Rotor, rotor_damping, rotor_load, thrust_slope
from sensors.loads.spectra import wave_number
from sensors.loads.waves import Sea, SeaState, wave_load
from sensors.loads.wind import Wind, aerodynamic_damping, wind_load
from sensors.sea_spectrum import jonswap

__all__ = [
    "BroadbandLoad",
    "FilteredNoise",
    "Load",
    "LoadError",
    "RandomLoad",
    "RandomStream",
    "Rotor",
    "Sea",
    "SeaState",
    "WaveBandLoad",
    "Wind",
    "aerodynamic_damping",
    "blade_pattern",
    "generator",
    "jonswap",
    "random_loads",
    "rotor_damping",
    "rotor_load",
    "spectral_kernel",
    "thrust_slope",
    "tower_pattern",
    "wave_kernel",
    "wave_load",
    "wave_number",
    "wave_pattern",
    "wave_profile",
    "white_kernel",
    "wind_load",
]
