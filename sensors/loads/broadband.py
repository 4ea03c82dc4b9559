"""Loads of a stated rms: white on every node, and with a sea's spectrum on the wetted ones.

They stand for what shakes a tower, with figures that are easy to reason about. A wind and a sea
that follow from their physics are in `wind.py` and `waves.py`.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sensors.arrays import FloatArray, IndexArray
from sensors.loads.filtered import RandomLoad, spectral_kernel, white_kernel
from sensors.loads.load import LoadError, RandomStream, require_not_negative
from sensors.loads.spectra import wave_number
from sensors.sea_spectrum import jonswap
from sensors.structure.structural_model import PLANE_COLUMNS, StructuralModel


@dataclass(frozen=True, slots=True)
class BroadbandLoad:
    """White load in both horizontal directions, independent from node to node.

    The total over n nodes has the stated rms in each direction, so a node has rms / √n. The
    series is white; a structure that feels it as straight lines between its samples
    (`modal_response`) feels 0.29 dB less at 12 Hz.
    """

    tower_rms: float = 50e3
    """Tower rms over all tower and monopile nodes, per direction [N]."""

    blade_rms: float = 15e3
    """Blade rms over the nodes of one blade, flapwise and edgewise each [N]."""

    highest_frequency: ClassVar[float] = 60.0
    """The rms is that of the band from 0 to here [Hz]."""

    def __post_init__(self) -> None:
        require_not_negative("broadband tower_rms", self.tower_rms, "N")
        require_not_negative("broadband blade_rms", self.blade_rms, "N")


@dataclass(frozen=True, slots=True)
class WaveBandLoad:
    """Load with the spectrum of a JONSWAP sea, coherent over the wetted nodes.

    Fore-aft and side-side are independent (a short-crested sea). Along the depth it follows the
    inertia force of linear waves of the peak period, cosh k(z + d). It stands for a sea's place in
    the spectrum, not for Morison's equation.
    """

    fore_aft_rms: float = 300e3
    """Total over the nodes, fore-aft [N]."""

    side_side_rms: float = 60e3
    """Total over the nodes, side-side [N]."""

    peak_period: ClassVar[float] = 8.0
    """Tp [s]."""

    peak_enhancement: ClassVar[float] = 3.3
    """γ [-], mean of the JONSWAP measurements."""

    highest_frequency: ClassVar[float] = 0.6
    """Cut of the spectrum [Hz]."""

    def __post_init__(self) -> None:
        require_not_negative("waves fore_aft_rms", self.fore_aft_rms, "N")
        require_not_negative("waves side_side_rms", self.side_side_rms, "N")


WAVE_KERNEL_DURATION = 300.0  # [s]: a resolution of .007 Hz, below the width of JONSWAP's peak


def wave_kernel(load: WaveBandLoad, sampling_rate: float) -> FloatArray:
    """Filter from white noise to a series with the load's spectrum, variance 1."""
    n_taps = 2 * round(0.5 * WAVE_KERNEL_DURATION * sampling_rate)
    frequencies = np.linspace(0.0, 0.5 * sampling_rate, n_taps // 2 + 1)
    density = jonswap(
        frequencies,
        peak_frequency=1.0 / load.peak_period,
        peak_enhancement=load.peak_enhancement,
    )
    density[frequencies > load.highest_frequency] = 0.0
    return spectral_kernel(density, sampling_rate)


def random_loads(
    model: StructuralModel,
    *,
    broadband: BroadbandLoad,
    waves: WaveBandLoad,
    sampling_rate: float,
) -> tuple[RandomLoad, ...]:
    """Return every load on the structure that is not switched off, as series at this rate [Hz]."""
    white = white_kernel(highest_frequency=broadband.highest_frequency, sampling_rate=sampling_rate)
    loads = []
    if broadband.tower_rms > 0:
        pattern = tower_pattern(model, broadband.tower_rms)
        loads.append(RandomLoad(pattern, white, sampling_rate, RandomStream.TOWER))
    if broadband.blade_rms > 0 and model.blade_dofs.size:
        pattern = blade_pattern(model, broadband.blade_rms)
        loads.append(RandomLoad(pattern, white, sampling_rate, RandomStream.BLADES))
    if waves.fore_aft_rms > 0 or waves.side_side_rms > 0:
        pattern = wave_pattern(model, waves)
        kernel = wave_kernel(waves, sampling_rate)
        loads.append(RandomLoad(pattern, kernel, sampling_rate, RandomStream.WAVES))
    return tuple(loads)


def tower_pattern(model: StructuralModel, rms: float) -> FloatArray:
    """Return a force at every tower and monopile node in each direction, independent of the others.

    Parameters
    ----------
    rms : float
        Rms of the n nodes' total in one direction [N], so rms / √n each.

    Returns
    -------
    ndarray, shape (n_dofs, 2n)
        Fore-aft nodes from the mudline up, then side-side ones [N].
    """
    dofs = np.concatenate([model.tower_dofs[:, plane.start] for plane in PLANE_COLUMNS.values()])
    return _one_force_each(model, dofs, rms / np.sqrt(len(model.elevations)))


def blade_pattern(model: StructuralModel, rms: float) -> FloatArray:
    """Return a force at every blade node but the root, flapwise and edgewise.

    Each is independent of the others.

    Parameters
    ----------
    rms : float
        Rms of the total over a blade's n nodes in one direction [N], so rms / √n each.

    Returns
    -------
    ndarray, shape (n_dofs, 2n · n_blades)
        [N].
    """
    flap_and_edge = model.blade_dofs[:, :, (0, 2)]
    n_nodes = flap_and_edge.shape[1]
    return _one_force_each(model, flap_and_edge.ravel(), rms / np.sqrt(n_nodes))


def wave_pattern(model: StructuralModel, waves: WaveBandLoad) -> FloatArray:
    """Forces of the wave band on the wetted nodes, (n_dofs, 2): fore-aft, side-side [N]."""
    water = model.description.water
    if water is None:
        raise LoadError(
            f"{model.description.name} has no [water]; set fore_aft_rms and side_side_rms of "
            "[simulation.waves] to 0"
        )
    profile = wave_profile(
        model.elevations,
        mudline=model.description.mudline,
        level=water.level,
        period=waves.peak_period,
    )
    pattern = np.zeros((model.n_dofs, 2))
    pattern[model.tower_dofs[:, PLANE_COLUMNS["FA"].start], 0] = waves.fore_aft_rms * profile
    pattern[model.tower_dofs[:, PLANE_COLUMNS["SS"].start], 1] = waves.side_side_rms * profile
    return pattern


def _one_force_each(model: StructuralModel, dofs: IndexArray, rms: float) -> FloatArray:
    pattern = np.zeros((model.n_dofs, len(dofs)))
    pattern[dofs, np.arange(len(dofs))] = rms
    return pattern


def wave_profile(
    elevations: FloatArray, *, mudline: float, level: float, period: float
) -> FloatArray:
    """Shares of the nodes in a wave's inertia force, (n_nodes,) [-]; they sum to 1.

    Parameters
    ----------
    elevations : ndarray, shape (n_nodes,)
        Elevations of the nodes, rising [m].
    mudline : float
        Mudline [m].
    level : float
        Level of the water [m].
    period : float
        Period of the wave [s].

    Returns
    -------
    ndarray, shape (n_nodes,)

    Notes
    -----
    The force per metre follows the water's acceleration, cosh k(z − mudline) from the mudline to
    the water's level; each metre's goes to its two nodes like a load on a simple beam.
    """
    depth = level - mudline
    if not depth > 0:
        raise LoadError(
            f"water level is {level:g} m; waves need it above the mudline at {mudline:g} m"
        )
    k = wave_number(1.0 / period, depth)
    points, weights = np.polynomial.legendre.leggauss(200)
    z = mudline + 0.5 * depth * (points + 1.0)
    force = weights * np.cosh(k * (z - mudline)) / np.cosh(k * depth)
    hats = np.array([np.interp(z, elevations, unit) for unit in np.eye(len(elevations))])
    shares = hats @ force
    return shares / shares.sum()
