"""A mode and its neighbours fitted together: resonances that overlap, or that share their flanks.

Of a mode of 4 % damping the resonance reaches over its neighbours', and a band that ends short of
these holds too little of it. Here the band goes on, and the neighbours in it are fitted with the
mode, starting from the poles. Bins are as wide as the resonances next to them allow, so that a
sharp neighbour costs no more than a wide one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode
from pipeline.oma.whittle.fit import (
    COLOUR,
    MOST_COLOUR_OFF,
    WhittleFit,
    cost_of_background,
    every_parameter,
    fitted,
    modes_of_fit,
    prior_noise,
    whitened,
)
from pipeline.oma.whittle.narrow_band import NarrowBand, WindowSpectrum
from pipeline.oma.whittle.spectral_model import CloseModes, expected_matrices, n_inner
from sensors.arrays import BoolArray, ComplexArray, FloatArray, IntArray

REACH_WIDTHS, REACH_LINES = 6.0, 10.0  # of a band beyond its mode, half bandwidths and lines
FAR_WIDTHS, FAR_SHARE = 12.0, 0.25  # or, of lightly damped modes, so many half bandwidths as far as
# this share of the frequency: colour and frequency are told apart far from the resonance. With 6
# half bandwidths the std of 78 modes of `structures` (seeds 160001 to 160018) was 1.36 attainable
# std, with 12 1.19, with the colour known 1.04; a band of half the frequency to either side pulled
# two modes of 4 and 7 % by 6 attainable std
LOWEST_END = 0.4  # of the mode's frequency, below which no band reaches [-]
SIDE_WIDTHS = 2.0  # of a band to either side, whatever its neighbours
CLEAR_WIDTHS, CLEAR_LINES = 4.0, 3.0  # between a band and a neighbour that is not fitted
BINS_A_WIDTH = 4.0  # of the distance from the nearest resonance, no less than its half bandwidth
FEWEST_BINS = 12
MOST_TOGETHER = 4  # modes of a band
MOST_STEPS = 20  # of 152 fits of `structures` (seeds 110001 to 110060) nine in ten took 13 or fewer
HIDDEN_SHARPER = np.array([1.0, 3.0, 10.0])  # half bandwidth of a mode over that of what it hides
LEFT_WIDTHS = 4.0  # half bandwidths from a mode within which something left unexplained matters


@dataclass(frozen=True, slots=True, eq=False)
class AroundMode:
    """A mode, its neighbours, and the lines that they share."""

    modes: tuple[Mode, ...]
    """The mode first."""
    band: NarrowBand

    @property
    def positions(self) -> FloatArray:
        """f T of each mode, (n_modes,) [lines]."""
        return np.array([mode.frequency for mode in self.modes]) * self.band.duration

    def fitted(self, most_colour_off: float = MOST_COLOUR_OFF) -> WhittleFit:
        """All modes together. Of a neighbour beyond the band, whose flank alone is in it, force and
        colour move; its frequency, damping and shape stay as the poles have them."""
        m, n_channels = len(self.modes), len(self.band.scales)
        numbers = self.band.numbers
        held: list[int] = []
        for place in np.flatnonzero(
            (self.positions < numbers[0]) | (self.positions > numbers[-1])
        ).tolist():
            shape = n_inner(m) + place * (n_channels - 1)
            held += [place, m + place, *range(shape, shape + n_channels - 1)]
        along = np.delete(every_parameter(m, n_channels, one_colour=False), held, axis=1)
        return fitted(
            self._start(),
            self.band,
            along,
            most_steps=MOST_STEPS,
            most_colour_off=most_colour_off,
        )

    def without_first(self) -> WhittleFit | None:
        """The neighbours alone in the same lines, whatever slope their background takes, since
        their cost is what counts; None where there are none."""
        return replace(self, modes=self.modes[1:]).fitted(np.inf) if len(self.modes) > 1 else None

    def evidence_of_first(self, fit: WhittleFit) -> float:
        """ln of the Bayes factor of a fit of all modes over one without the first [nats]."""
        without, n_lines = self.without_first(), self.band.n_lines
        cost = cost_of_background(self.band) if without is None else without.bayes_cost(n_lines)
        return cost - fit.bayes_cost(n_lines)

    def _start(self) -> CloseModes:
        """The modes as the poles have them, with the forces that their lines need."""
        band = self.band
        widths = np.array([bounded_half_bandwidth(mode) for mode in self.modes]) * band.duration
        shapes = np.column_stack(
            [mode.shape / band.accelerations(mode.frequency) for mode in self.modes]
        )
        noise = np.diag(10 * prior_noise(band))
        into = np.linalg.pinv(shapes / np.sqrt(np.diag(noise))[:, None]) / np.sqrt(np.diag(noise))
        powers = [
            _power(row, band, position, width)
            for row, position, width in zip(into, self.positions, widths, strict=True)
        ]
        forces = np.diag(np.sqrt(powers) * 2 * np.pi * widths).astype(complex)
        colours = np.full(len(self.modes), COLOUR)
        return CloseModes(self.positions, widths, shapes, forces, colours, noise)


def around_mode(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> AroundMode | None:
    """A mode with its neighbours and their lines; None where these leave it too few.

    Parameters
    ----------
    mode : Mode
    others : sequence of Mode
        All that surround it.
    spectrum : WindowSpectrum
    """
    T, width = spectrum.duration, bounded_half_bandwidth(mode)
    low, high = reach_of(mode, T)
    modes = [mode]
    for each in sorted(others, key=lambda other: abs(other.frequency - mode.frequency)):
        clear = CLEAR_WIDTHS * bounded_half_bandwidth(each) + CLEAR_LINES / T
        if not low - clear < each.frequency < high + clear:
            continue
        if len(modes) < MOST_TOGETHER:
            modes.append(each)
        elif each.frequency < mode.frequency:
            low = max(low, each.frequency + clear)
        else:
            high = min(high, each.frequency - clear)
    edges = np.minimum(_edges(low * T, min(high * T, spectrum.last), modes, T), spectrum.last + 1)
    narrow = min(mode.frequency - low, high - mode.frequency) < SIDE_WIDTHS * width
    if narrow or len(edges) <= FEWEST_BINS:
        return None
    return AroundMode(tuple(modes), spectrum.uneven_band(edges))


def reach_of(mode: Mode, duration: float) -> tuple[float, float]:
    """Ends of a mode's band, whatever its neighbours [Hz]. duration: T of the window [s]"""
    width = bounded_half_bandwidth(mode)
    far = min(FAR_WIDTHS * width, FAR_SHARE * mode.frequency)
    reach = REACH_LINES / duration + max(REACH_WIDTHS * width, far)
    return max(mode.frequency - reach, LOWEST_END * mode.frequency), mode.frequency + reach


def _edges(low: float, high: float, modes: Sequence[Mode], duration: float) -> IntArray:
    """First lines of bins, and the end of the last one."""
    places = np.array([mode.frequency for mode in modes]) * duration
    widths = np.array([bounded_half_bandwidth(mode) for mode in modes]) * duration
    edges = [max(1, round(low))]
    while edges[-1] < high:
        distance = float(np.hypot(widths, edges[-1] - places).min())
        edges.append(edges[-1] + max(1, int(distance / BINS_A_WIDTH)))
    return np.array(edges)


def _power(row: FloatArray, band: NarrowBand, position: float, width: float) -> float:
    """Of a modal coordinate, row · y, at its resonance."""
    distance = np.abs(band.numbers - position)
    near = distance <= max(width, float(distance.min()))
    return float(np.mean((row @ band.matrices[near] @ row).real))


def first_mode(fit: WhittleFit, band: NarrowBand) -> Mode:
    """The first mode of a fit with the covariance that the lines leave it."""
    return modes_of_fit(fit, band)[0]


def left_near_first(fit: WhittleFit, band: NarrowBand) -> float:
    """Rise of ln p that one mode more, as wide as the first one, would promise near it [nats]."""
    width = float(fit.modes.half_widths[0])
    return max((gain for gain, _ in _places_left(fit, band, width)), default=0.0)


def hidden_by_first(around: AroundMode, fit: WhittleFit) -> Mode:
    """Where a fit leaves most unexplained near its first mode: a mode as wide as that one or
    sharper, for a fit to begin with."""
    band = around.band
    (_, span), width = max(
        (
            (place, width)
            for width in fit.modes.half_widths[0] / HIDDEN_SHARPER
            for place in _places_left(fit, band, width)
        ),
        key=lambda entry: entry[0][0],
    )
    counts = band.n_together[span]
    centre = float(counts @ band.numbers[span] / counts.sum())
    mean = np.tensordot(counts, whitened(fit.modes, band)[span].real, axes=1)
    direction = np.linalg.eigh(mean)[1][:, -1]
    lower = np.linalg.cholesky(expected_matrices(fit.modes, np.array([centre])))[0]
    frequency = centre / band.duration
    shape = (lower @ direction).real * band.accelerations(frequency)
    return replace(
        around.modes[0],
        frequency=frequency,
        damping_ratio=float(width) / centre,
        damping_ratio_std=0.0,
        shape=shape / shape[np.argmax(np.abs(shape))],
    )


def _places_left(fit: WhittleFit, band: NarrowBand, width: float) -> list[tuple[float, BoolArray]]:
    """Gain and bins of every place near the first mode. width: half bandwidth there [lines]"""
    reach = LEFT_WIDTHS * fit.modes.half_widths[0]
    white = whitened(fit.modes, band)
    centres = band.numbers[np.abs(band.numbers - fit.modes.positions[0]) <= reach]
    spans = [np.abs(band.numbers - centre) <= max(0.5 * width, 1.0) for centre in centres]
    return [(_gain(white, band.n_together, span), span) for span in spans]


def _gain(white: ComplexArray, n_together: FloatArray, span: BoolArray) -> float:
    """n (s − 1 − ln s) of n lines with power s in their strongest direction where 1 is expected."""
    counts = n_together[span]
    mean = np.tensordot(counts, white[span].real, axes=1) / counts.sum()
    power = float(np.linalg.eigvalsh(mean)[-1])
    return float(counts.sum() * (power - 1 - np.log(power))) if power > 1 else 0.0


def bounded_half_bandwidth(mode: Mode) -> float:
    """ζ f; of a mode whose damping is hardly known, no less than half its std makes it [Hz]."""
    return max(mode.damping_ratio, 0.5 * mode.damping_ratio_std) * mode.frequency
