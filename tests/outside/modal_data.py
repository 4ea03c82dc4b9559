"""Modal estimates as an identification would give them, drawn about the modes of a true structure.

Which modes are found follows from what the loads make of them at the sensors, against the other
modes and the noise there. Each found mode has a frequency and a shape with an error of its window,
an error that stays over all windows, and a covariance that was estimated from a few time blocks.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.arrays import FloatArray
from tests.outside.figures import KNOWN_LEVEL_STD, Figures, draw
from tests.outside.instruments import Instruments, SensorFault, instruments
from tests.outside.loads import STRONG, Loads, modal_force_spectrum
from tests.outside.model import HIGHEST_FREQUENCY as COMPUTED_FREQUENCY
from tests.outside.model import NOMINAL, Description, Modes, SpringSign, assemble
from tests.outside.piles import Pile, modes_on

LOWEST, HIGHEST = 0.8, 1.25  # true stiffness / nominal in `drawn_truth` [-]
DAMPING = 0.007  # ζ of every mode [-]
DURATION = 600.0  # T of a window [s]
HIGHEST_FREQUENCY = 12.5  # of the modes that an identification reports [Hz]
NOISE_SHARE = 0.03  # of each channel's rms, white up to half the sampling rate [-]
NYQUIST = 20.0  # [Hz]
BLOCKS = 40  # time blocks from which a covariance is estimated
RESOLUTION = 1.5  # modes nearer than this over T are one peak
FREQUENCY_FLOOR, SHAPE_FLOOR = 5e-4, 3e-3  # errors that stay over the windows [-]
# of a component: what stands in even a clear mode, and what its surroundings add, see `_shape_std`
SHAPE_STD, BLURRED_SHAPE_STD, LARGEST_SHAPE_STD = 0.001, 0.07, 0.3  # [-]
HALF_FOUND = 2.5  # dominance (see `_dominance`) at which every other window shows a mode [-]
CROSSTALK = (
    0.1  # of another mode's response in whatever direction, as an identification feels it [-]
)
BOTH_FOUND = 0.1  # share of windows that resolve a pair nearer than the resolution [-]
LAYOUT = biaxial_layout(
    "outside", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What the estimates are drawn about."""

    theta: FloatArray
    """k11 [N/m], k22 [N·m/rad], k12 [N/rad], (3,)."""
    figures: Figures = field(default_factory=Figures)
    sign: SpringSign = "published"
    description: Description | None = None
    """None: uniform tubes and blade lengths."""
    pile: Pile | None = None
    """What the springs stand for; None: the structure stands on the springs."""

    def modes(
        self, level: float | None = None, *, highest_frequency: float = COMPUTED_FREQUENCY
    ) -> Modes:
        """Its modes; in water of another level above the mean [m]."""
        figures = self.figures if level is None else self.figures.with_level(level)
        structure = assemble(figures, self.description)
        if self.pile is not None:
            return modes_on(self.pile, structure, highest_frequency)
        return structure.modes(self.theta, self.sign, highest_frequency)


def drawn_truth(
    rng: np.random.Generator,
    sign: SpringSign = "published",
    *,
    level_std: float = KNOWN_LEVEL_STD,
    description: Description | None = None,
) -> Truth:
    """Draw springs in .8 to 1.25 of nominal and every figure from its prior.

    The sea stands at its mean as far as anything reports it; truly `level_std` [m] about it.
    """
    figures = draw(rng, level_std=level_std)
    structure = assemble(figures, description)
    while True:
        theta = NOMINAL * rng.uniform(LOWEST, HIGHEST, 3)
        try:
            structure.modes(theta, sign, 1.0)
        except ValueError:  # not positive definite, or unstable under the tower's weight
            continue
        return Truth(theta, figures, sign, description)


@dataclass(frozen=True, slots=True)
class Errors:
    """How the estimates err."""

    frequency_floor: float = FREQUENCY_FLOOR
    """Relative std of the error that all windows share [-]."""
    shape_floor: float = SHAPE_FLOOR
    """The same of a component, the largest being 1 [-]."""
    scale: float = 1.0
    """Factor on the errors of a window and on their stated deviations; 1 is the bound [-]."""


IDENTIFIED = Errors(scale=1.5)
"""As far as the product's identification of `records` scatters (24 strong windows of one truth:
median over the modes of the frequency's standard deviation over the bound 1.49)."""


@dataclass(frozen=True, slots=True, eq=False)
class _Visible:
    """Modes as the sensors see them in one window's water; one row a mode."""

    numbers: NDArray[np.intp]
    """Place among the structure's modes."""
    frequencies: FloatArray
    """[Hz]"""
    shapes: FloatArray
    """(n, n_channels), largest component 1 [-]."""
    dominance: FloatArray
    """Peak over what else is there at its frequency and shape [-]."""


def estimates(
    truth: Truth,
    n_windows: int,
    rng: np.random.Generator,
    *,
    levels: Sequence[float] | None = None,
    reported_levels: Sequence[float] | None = None,
    layout: SensorLayout = LAYOUT,
    faults: Iterable[SensorFault] = (),
    loads: Loads = STRONG,
    errors: Errors | None = None,
    lasting: dict[int, FloatArray] | None = None,
) -> list[ModalEstimate]:
    """Draw the modal estimates of consecutive windows.

    Parameters
    ----------
    truth : Truth
        The structure; its `figures.water_level` holds where `levels` is None.
    n_windows : int
        How many windows of 600 s.
    rng : Generator
        Source of randomness.
    levels : sequence of float, optional
        True sea level of each window above the mean [m].
    reported_levels : sequence of float, optional
        What SCADA reports of it [m]; None: nothing.
    layout : SensorLayout
        DC accelerometers, as stated.
    faults : iterable of SensorFault
        What is wrong with them.
    loads : Loads
        They decide which modes are found.
    errors : Errors, optional
        None: the defaults.
    lasting : dict, optional
        The errors that stay over the windows, by mode; filled here, so that a further call with the
        same one goes on with them.

    Returns
    -------
    list of ModalEstimate
        With names "m1", "m2", … that stay with a mode from window to window.
    """
    errors = errors or Errors()
    true_levels = [truth.figures.water_level] * n_windows if levels is None else list(levels)
    reported = [np.nan] * n_windows if reported_levels is None else list(reported_levels)
    sensors = instruments(layout, faults)
    cache: dict[float, _Visible] = {}
    persistent = {} if lasting is None else lasting
    found = []
    for window, (level, report) in enumerate(zip(true_levels, reported, strict=True)):
        if level not in cache:
            cache[level] = visible_modes(truth.modes(level), sensors, loads)
        modes = _found(cache[level], persistent, errors, rng)
        found.append(_estimate(modes, layout, window, float(report)))
    return found


def visible_modes(
    modes: Modes, sensors: SensorLayout | Instruments, loads: Loads = STRONG
) -> _Visible:
    """Take the modes up to `HIGHEST_FREQUENCY` as sensors see them."""
    if isinstance(sensors, SensorLayout):
        sensors = instruments(sensors)
    numbers = np.flatnonzero(modes.frequencies <= HIGHEST_FREQUENCY)
    readings = modes.readings(sensors.true) * sensors.gains
    dominance = _dominance(modes.frequencies, readings, modal_force_spectrum(modes, loads))
    largest = np.argmax(np.abs(readings), axis=1)[:, None]
    shapes = readings / np.take_along_axis(readings, largest, axis=1)
    return _Visible(numbers, modes.frequencies[numbers], shapes[numbers], dominance[numbers])


def _dominance(frequencies: FloatArray, readings: FloatArray, forces: FloatArray) -> FloatArray:
    """Spectral peak of each mode along its own shape over the rest's there, (n_modes,) [-].

    The rest: every other mode's response at this frequency, projected on this mode's shape, a
    share `CROSSTALK` of what is not along it, and the noise of the channels, white with
    `NOISE_SHARE` of each channel's rms.
    """
    units = readings / np.linalg.norm(readings, axis=1, keepdims=True)
    ratio = frequencies[:, None] / frequencies
    gain = ratio**4 / ((1 - ratio**2) ** 2 + (2 * DAMPING * ratio) ** 2)  # |H|², (at, of)
    along = (units @ readings.T) ** 2 * forces * gain
    across = (readings**2).sum(axis=1) * forces * gain - along
    own = np.diag(along)
    variance = (readings**2 * (forces * np.pi * frequencies / (4 * DAMPING))[:, None]).sum(axis=0)
    noise = (units**2) @ (NOISE_SHARE**2 * variance / NYQUIST)
    return own / ((along + CROSSTALK * across).sum(axis=1) - own + noise)


def _found(
    visible: _Visible,
    persistent: dict[int, FloatArray],
    errors: Errors,
    rng: np.random.Generator,
) -> list[Mode]:
    """Draw which modes one window shows and how, lowest frequency first."""
    modes = []
    for peak in _peaks(visible, rng):
        if peak.number not in persistent:
            persistent[peak.number] = rng.standard_normal(1 + len(peak.shape))
        floor = np.append(errors.frequency_floor, np.full(len(peak.shape), errors.shape_floor))
        modes.append(_drawn_mode(peak, floor * persistent[peak.number], errors.scale, rng))
    return sorted(modes, key=lambda mode: mode.frequency)


@dataclass(frozen=True, slots=True, eq=False)
class _Peak:
    """What one window shows of a mode, or of two that it cannot separate."""

    number: int
    frequency: float
    """[Hz]"""
    shape: FloatArray
    """(n_channels,) [-]"""
    dominance: float
    pair_id: str = ""


def _peaks(visible: _Visible, rng: np.random.Generator) -> list[_Peak]:
    """Draw the peaks of one window; of a pair nearer than the resolution mostly one."""
    chance = visible.dominance / (visible.dominance + HALF_FOUND)
    shown = np.flatnonzero(rng.uniform(size=len(chance)) < chance).tolist()
    peaks: list[_Peak] = []
    while shown:
        i = shown.pop(0)
        near = bool(shown) and _gap(visible, i, shown[0]) < RESOLUTION / DURATION
        if not near:
            peaks.append(_peak(visible, i))
            continue
        j = shown.pop(0)
        if rng.uniform() < BOTH_FOUND:
            pair_id = f"{visible.frequencies[i]:.4f} Hz"
            peaks += [_peak(visible, i, pair_id), _peak(visible, j, pair_id)]
        else:
            peaks.append(_blended(visible, i, j, rng))
    return peaks


def _gap(visible: _Visible, i: int, j: int) -> float:
    return abs(float(visible.frequencies[i] - visible.frequencies[j]))


def _peak(visible: _Visible, i: int, pair_id: str = "") -> _Peak:
    return _Peak(
        number=int(visible.numbers[i]),
        frequency=float(visible.frequencies[i]),
        shape=visible.shapes[i],
        dominance=float(visible.dominance[i]),
        pair_id=pair_id,
    )


def _blended(visible: _Visible, i: int, j: int, rng: np.random.Generator) -> _Peak:
    """The stronger of two modes, drawn towards the other one by up to a third."""
    weak, strong = sorted((i, j), key=lambda mode: float(visible.dominance[mode]))
    share = rng.uniform(0.0, 1 / 3)
    frequencies = visible.frequencies
    return replace(
        _peak(visible, strong),
        frequency=float((1 - share) * frequencies[strong] + share * frequencies[weak]),
        shape=visible.shapes[strong] + share * rng.normal() * visible.shapes[weak],
    )


def _drawn_mode(peak: _Peak, offset: FloatArray, scale: float, rng: np.random.Generator) -> Mode:
    """One mode with errors of its window, its covariance estimated from `BLOCKS` time blocks.

    std f / f = √(ζ / (2π f T)) for a mode alone in white noise (Gersch 1974, Journal of Sound and
    Vibration 34), the same for ζ itself; more where the mode does not stand out.
    """
    relative = np.sqrt(DAMPING / (2 * np.pi * peak.frequency * DURATION))
    relative *= scale * np.sqrt(1 + 1 / peak.dominance)
    deviations = np.array([relative * peak.frequency, relative])
    deviations = np.append(deviations, np.full(len(peak.shape), scale * _shape_std(peak)))
    error = deviations * rng.standard_normal(len(deviations))
    factor = deviations[:, None] * rng.standard_normal((len(deviations), BLOCKS)) / np.sqrt(BLOCKS)
    shape = peak.shape + offset[1:] + error[2:]
    unit = int(np.argmax(np.abs(shape)))
    normalised = shape / shape[unit]
    # d(φ / φ_u) = (dφ − φ/φ_u dφ_u) / φ_u: the unit component's row becomes zero (Eq. 11)
    factor[2:] = (factor[2:] - np.outer(normalised, factor[2 + unit])) / shape[unit]
    factor[2 + unit] = 0.0
    std = np.linalg.norm(factor, axis=1)
    return Mode(
        name=f"m{peak.number + 1}",
        frequency=float(peak.frequency * (1 + offset[0]) + error[0]),
        frequency_std=float(std[0]),
        damping_ratio=float(max(DAMPING + error[1], 0.2 * DAMPING)),
        damping_ratio_std=float(std[1]),
        shape=normalised,
        covariance_factor=factor,
        n_block_columns=BLOCKS,
        pair_id=peak.pair_id,
    )


def _shape_std(peak: _Peak) -> float:
    """Of a component of a mode's shape, the largest being 1 [-].

    By eye through what identified records scatter, over 1.5. Those gave, above 3 Hz, .004 for a
    dominance of 850, .009 for 230, .013 for 65, .02 for 21, .047 for 11; more below.
    """
    blurred = BLURRED_SHAPE_STD / np.sqrt(peak.dominance) * np.sqrt(max(1.0, 3 / peak.frequency))
    return float(min(SHAPE_STD + blurred, LARGEST_SHAPE_STD))


def _estimate(
    modes: list[Mode], layout: SensorLayout, window: int, water_level: float
) -> ModalEstimate:
    start = round(window * DURATION * NANOSECONDS)
    return ModalEstimate(
        turbine=layout.turbine,
        window=window,
        start_ns=start,
        end_ns=start + round(DURATION * NANOSECONDS),
        layout_id=layout.layout_id,
        channels=layout.channel_names,
        modes=tuple(modes),
        water_level=water_level,
    )
