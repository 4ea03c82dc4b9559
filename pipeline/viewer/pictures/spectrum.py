"""Spectra of a window with the modes identified in it, as a picture. No rerun here.

A panel for the fore-aft channels, one for the side-side and one for the vertical channels, where
there are any; picture units, y down. Stabilisation diagrams share the logarithmic frequency axis.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import rfft, rfftfreq

from pipeline.state.phrases import in_hertz
from pipeline.viewer.pictures.corner import Text
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.arrays import FloatArray

HEIGHT, PITCH = 1.0, 1.35  # of a panel, and from one to the next [picture units]
SEGMENT = 100.0  # of Welch's method [s]: a resolution of 0.01 Hz
FREQUENCY_BINS = 400  # of the logarithmic axis; the highest value of each is drawn
DECADES = 6.0  # of spectral density shown below the highest
KEPT_DURATION = 3600.0  # of samples held for windows still to come [s]
AXIS_TITLES = ("fore-aft", "side-side", "vertical")
PANEL_WIDTH = 2.6  # of a panel [picture units]
COMPLETE = 0.99  # share of a window's samples; with fewer the picture says how much it shows [-]
LOWEST = 0.1  # left end [Hz]
LABEL_DISTANCE = 0.27  # between two frequencies written above a panel [picture units]


@dataclass(frozen=True, slots=True)
class FrequencyAxis:
    """A logarithmic axis from `low` at 0 to `high` at WIDTH."""

    low: float
    """Left end [Hz]."""
    high: float
    """Right end [Hz]."""

    def position(self, frequency: FloatArray | float) -> FloatArray:
        """Return the position of a frequency [Hz] on the axis [picture units]."""
        share = np.log(np.asarray(frequency) / self.low) / np.log(self.high / self.low)
        return PANEL_WIDTH * share

    @property
    def ticks(self) -> list[float]:
        """1, 2 and 5 times powers of ten within the axis [Hz]."""
        round_numbers = [digit * 10.0**power for power in range(-2, 4) for digit in (1, 2, 5)]
        return [number for number in round_numbers if self.low <= number <= self.high]

    def tick_texts(self, y: float) -> list[Text]:
        """Return the numbers at the ticks, at height y."""
        return [Text((float(self.position(tick)), y), f"{tick:g}") for tick in self.ticks]

    def shown(self, frequencies: Sequence[float]) -> list[float]:
        """Return the frequencies within the axis, lowest first."""
        return sorted(f for f in frequencies if self.low <= f <= self.high)

    def mode_texts(self, frequencies: Sequence[float], y: float) -> tuple[Text, ...]:
        """Return frequencies at height y, leaving out those without room."""
        texts: list[Text] = []
        for frequency in self.shown(frequencies):
            x = float(self.position(frequency))
            if not texts or x - texts[-1].position[0] >= LABEL_DISTANCE:
                texts.append(Text((x, y), in_hertz(frequency)))
        return tuple(texts)


def frame(top: float, bottom: float) -> FloatArray:
    """Return the outline of a panel over the whole axis, shape (5, 2)."""
    return np.array(
        [[0, top], [PANEL_WIDTH, top], [PANEL_WIDTH, bottom], [0, bottom], [0, top]], dtype=float
    )


def vertical_line(axis: FrequencyAxis, frequency: float, top: float, bottom: float) -> FloatArray:
    """Return an upright line at a frequency [Hz], shape (2, 2)."""
    x = float(axis.position(frequency))
    return np.array([[x, top], [x, bottom]])


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumPicture:
    """Everything to draw, in picture units."""

    spectra: tuple[FloatArray, ...]
    """One line per channel, shape (n, 2)."""
    levels: tuple[int, ...]
    """Which level of the tower each line belongs to, lowest 0."""
    modes: tuple[FloatArray, ...]
    """(2, 2) an upright line at each identified frequency."""
    frames: tuple[FloatArray, ...]
    """Outlines of panels and ticks."""
    texts: tuple[Text, ...]


class RecentSamples:
    """The samples of one unit's latest hour, for windows identified later."""

    def __init__(self) -> None:
        self._blocks: deque[AccelerationBlock] = deque()

    def push(self, block: AccelerationBlock) -> None:
        """Add a block and drop those that are too old."""
        self._blocks.append(block)
        while self._blocks[0].start_ns < block.start_ns - KEPT_DURATION * NANOSECONDS:
            self._blocks.popleft()

    def between(self, start_ns: int, end_ns: int) -> tuple[NDArray[np.float32], float] | None:
        """Return the samples of the blocks that begin in a window, and their rate.

        Shape (n, n_channels) [m/s²], [Hz]; None where there are none or their channels or rates
        differ.
        """
        inside = [block for block in self._blocks if start_ns <= block.start_ns < end_ns]
        if len({(block.samples.shape[1], block.sampling_rate) for block in inside}) != 1:
            return None
        return np.concatenate([block.samples for block in inside]), inside[0].sampling_rate


def spectrum_picture(
    samples: NDArray[np.float32],
    sampling_rate: float,
    layouts: Sequence[SensorLayout],
    frequencies: Sequence[float],
    *,
    duration: float,
) -> SpectrumPicture:
    """Draw power spectral densities of all channels over a logarithmic axis.

    A missing sample counts as the channel's mean.

    Parameters
    ----------
    samples : ndarray of float, shape (n, n_channels)
        Samples of the window [m/s²].
    sampling_rate : float
        Sampling rate [Hz].
    layouts : Sequence[SensorLayout]
        Of the units whose channels these are, one after the other.
    frequencies : Sequence[float]
        Natural frequencies of the identified modes [Hz].
    duration : float
        Of the window [s]; where there are fewer samples, the picture says so.
    """
    layout = joined_layout(layouts)
    finite = np.where(np.isfinite(samples), samples, np.nan)
    steady = np.nan_to_num(finite - np.nanmean(finite, axis=0))
    f, densities = power_spectral_densities(steady, sampling_rate)
    axis = FrequencyAxis(LOWEST, sampling_rate / 2)
    sides = measured_sides(layout)
    top = float(np.log10(max(densities[f >= LOWEST].max(), 1e-30)))
    levels = [level for each in layouts for level in _levels(each)]
    held = len(samples) / sampling_rate
    note = "" if held > COMPLETE * duration else f"; {held / 60:.3g} of {duration / 60:.3g} min"
    curves = _curves(axis, f, densities, top)
    lines = [
        (curves[channel] + [0.0, panel * PITCH], channel)
        for panel, side in enumerate(sides)
        for channel in channels_along(layout, side)
    ]
    shown = axis.shown(frequencies)
    panels = [(panel * PITCH, panel * PITCH + HEIGHT) for panel in range(len(sides))]
    units = {channel.unit for channel in layout.channels}
    unit = units.pop() if len(units) == 1 else "unit"
    return SpectrumPicture(
        spectra=tuple(line for line, _ in lines),
        levels=tuple(levels[channel] for _, channel in lines),
        modes=tuple(
            vertical_line(axis, frequency, *panel) for panel in panels for frequency in shown
        ),
        frames=tuple(frame(*panel) for panel in panels),
        texts=_axis_texts(axis, top, unit, [AXIS_TITLES[side] for side in sides], note)
        + axis.mode_texts(shown, -0.06),
    )


def measured_sides(layout: SensorLayout) -> list[int]:
    """Return what the channels measure: 0 for fore-aft, 1 for side-side, 2 for vertical."""
    return [side for side in range(3) if channels_along(layout, side)]


def channels_along(layout: SensorLayout, axis: int) -> list[int]:
    """Return the channels along an axis: within 45° of it, or nearer to it than to the others."""
    shares = np.abs(layout.directions).reshape(-1, 3)
    return np.flatnonzero((shares[:, axis] > 0.7) | (shares.argmax(axis=1) == axis)).tolist()


def _levels(layout: SensorLayout) -> list[int]:
    """Return which level of its unit each channel is at, lowest 0: its colour."""
    levels = sorted({channel.elevation for channel in layout.channels})
    return [levels.index(channel.elevation) for channel in layout.channels]


def power_spectral_densities(
    samples: NDArray[np.float32], sampling_rate: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Estimate frequencies (n,) [Hz] and one-sided densities (n, n_channels) [(m/s²)²/Hz].

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
        [m/s²].
    sampling_rate : float
        [Hz].

    Notes
    -----
    Welch's method with Hann segments of SEGMENT [s] that overlap by half, each without its mean.
    Single precision suffices: its rounding is some 13 decades below the signal.
    """
    length = min(len(samples), round(SEGMENT * sampling_rate))
    window = (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)).astype(np.float32)
    columns = np.ascontiguousarray(samples.T)
    segments = sliding_window_view(columns, length, axis=1)[:, :: max(1, length - length // 2)]
    spectra = rfft((segments - segments.mean(axis=2, keepdims=True)) * window, axis=2)
    densities = np.mean(np.abs(spectra) ** 2, axis=1).T
    densities *= 2 / (sampling_rate * np.sum(window**2))
    densities[0] /= 2
    if length % 2 == 0:
        densities[-1] /= 2
    return rfftfreq(length, 1 / sampling_rate), densities


def _curves(
    axis: FrequencyAxis, f: FloatArray, densities: NDArray[np.float32], top: float
) -> list[FloatArray]:
    """Return every channel's spectrum in the first panel: the highest value in each bin."""
    edges = np.geomspace(axis.low, axis.high, FREQUENCY_BINS + 1)
    inside = (f >= axis.low) & (f < axis.high)
    bins, first = np.unique(np.digitize(f[inside], edges) - 1, return_index=True)
    highest = np.maximum(np.maximum.reduceat(densities[inside], first, axis=0), 1e-30)
    x = axis.position(np.sqrt(edges[bins] * edges[bins + 1]))
    y = np.clip((np.log10(highest) - top) / DECADES + 1.0, 0.0, 1.0)
    return [np.stack([x, 1.0 - 0.96 * y[:, i]], axis=1) for i in range(y.shape[1])]


def _axis_texts(
    axis: FrequencyAxis, top: float, unit: str, names: Sequence[str], note: str
) -> tuple[Text, ...]:
    panels = range(len(names))
    texts = [text for panel in panels for text in axis.tick_texts(panel * PITCH + HEIGHT + 0.05)]
    texts += [
        Text((-0.13, panel * PITCH + 1.0 - 0.96 * (1.0 - below / DECADES)), f"1e{top - below:.0f}")
        for panel in panels
        for below in range(0, int(DECADES), 2)
    ]
    for panel, name in enumerate(names):
        middle = (PANEL_WIDTH / 2, panel * PITCH + HEIGHT + 0.2)
        density = f"({unit})²/Hz" if unit else "1/Hz, unscaled"
        texts.append(Text(middle, f"frequency [Hz], {name}; density [{density}]{note}"))
    return tuple(texts)
