"""Loads on the parked turbine: white forces on tower and blades, waves on the wetted monopile."""

from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray
from tests.outside import sections as iea
from tests.outside.model import N_BLADES, Modes, Structure

TOWER_POINTS = np.linspace(-25.0, 145.0, 18)  # elevations with forces of their own [m]
BLADE_POINTS = np.linspace(19.5, 117.0, 6)  # distances from the root [m]
WAVE_POINTS = np.linspace(-27.0, -1.0, 9)  # elevations [m]
BAND = 60.0  # over which the rms of a white force is counted [Hz]
PEAK_PERIOD, PEAK_ENHANCEMENT = 8.0, 3.3  # of the JONSWAP spectrum [s], [-]
HIGHEST_WAVE_FREQUENCY = 0.6  # [Hz]
WATER_DEPTH = 30.0  # [m]


@dataclass(frozen=True, slots=True)
class Loads:
    """Rms forces; white ones are independent from point to point."""

    tower: float = 50e3
    """White, over all points of tower and monopile, in x and in y each [N]."""
    blade: float = 15e3
    """White, over the points of one blade, flapwise and edgewise each [N]."""
    fore_aft_waves: float = 300e3
    """Total, coherent along the depth [N]."""
    side_side_waves: float = 60e3
    """Total, coherent along the depth [N]."""


STRONG = Loads()
WEAK = Loads(tower=20e3, blade=0.0, fore_aft_waves=1e6, side_side_waves=2e5)


def white_rows(structure: Structure, loads: Loads) -> FloatArray:
    """(n_forces, n_dofs): each white force's rms [N] times where it acts."""
    rows = [
        loads.tower / np.sqrt(len(TOWER_POINTS)) * structure.displacement_row(z, direction)
        for z in TOWER_POINTS
        for direction in np.eye(3)[:2]
    ]
    rows += [
        loads.blade / np.sqrt(len(BLADE_POINTS)) * structure.blade_row(blade, distance, direction)
        for blade in range(N_BLADES if structure.description.blade and loads.blade else 0)
        for distance in BLADE_POINTS
        for direction in structure.blade_axes(blade).T[:2]
    ]
    return np.array(rows)


def wave_rows(structure: Structure, loads: Loads) -> FloatArray:
    """(2, n_dofs): rms of the waves' force in x and in y [N] times where it acts.

    Along the depth it follows the acceleration of linear waves of the peak period,
    cosh k (z + d) with ω² = g k tanh k d.
    """
    number = _wave_number(2 * np.pi / PEAK_PERIOD)
    shares = np.cosh(number * (WAVE_POINTS + WATER_DEPTH))
    shares /= shares.sum()
    return np.array(
        [
            rms
            * sum(
                share * structure.displacement_row(z, direction)
                for share, z in zip(shares, WAVE_POINTS, strict=True)
            )
            for rms, direction in (
                (loads.fore_aft_waves, (1.0, 0.0, 0.0)),
                (loads.side_side_waves, (0.0, 1.0, 0.0)),
            )
        ]
    )


def wave_spectrum(frequencies: FloatArray) -> FloatArray:
    """One-sided JONSWAP spectrum of unit variance, cut at `HIGHEST_WAVE_FREQUENCY` [1/Hz]."""
    grid = np.linspace(0.01, HIGHEST_WAVE_FREQUENCY, 2000)
    return _jonswap(frequencies) / np.trapezoid(_jonswap(grid), grid)


def modal_force_spectrum(modes: Modes, loads: Loads) -> FloatArray:
    """One-sided spectral density of each mode's force at its frequency, (n_modes,) [N²/(kg·Hz)]."""
    white = ((white_rows(modes.structure, loads) @ modes.vectors) ** 2).sum(axis=0) / BAND
    waves = ((wave_rows(modes.structure, loads) @ modes.vectors) ** 2).sum(axis=0)
    return white + waves * wave_spectrum(modes.frequencies)


def _jonswap(frequencies: FloatArray) -> FloatArray:
    """S(f) ∝ f⁻⁵ exp(−1.25 (f_p/f)⁴) γ^r (Hasselmann et al. 1973), without its constant."""
    f, peak = np.maximum(frequencies, 1e-3), 1 / PEAK_PERIOD
    width = np.where(f <= peak, 0.07, 0.09)
    r = np.exp(-((f - peak) ** 2) / (2 * (width * peak) ** 2))
    spectrum = f**-5 * np.exp(-1.25 * (peak / f) ** 4) * PEAK_ENHANCEMENT**r
    return np.where(frequencies <= HIGHEST_WAVE_FREQUENCY, spectrum, 0.0)


def _wave_number(omega: float) -> float:
    """Solve ω² = g k tanh k d for k [1/m]."""
    k = omega**2 / iea.GRAVITY
    for _ in range(50):
        k = 0.5 * (k + omega**2 / (iea.GRAVITY * np.tanh(k * WATER_DEPTH)))
    return float(k)
