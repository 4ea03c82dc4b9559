"""Time histories of a true structure: what its accelerometers read, as arrays, blocks and files.

Every mode below the highest frequency takes part with the same damping. The forces are Gaussian
and stationary, drawn as Fourier coefficients up to half the sampling rate; the response is exact at
each frequency (the samples are those behind an ideal anti-alias filter). A margin is drawn on top
and cut off, so that the record's end does not run into its beginning.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.fft import irfft, next_fast_len, rfftfreq

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import ComplexArray, FloatArray
from tests.outside.instruments import SensorFault, instruments
from tests.outside.loads import BAND, STRONG, Loads, wave_rows, wave_spectrum, white_rows
from tests.outside.modal_data import DAMPING, LAYOUT, NOISE_SHARE, Truth
from tests.outside.model import Modes

WINDOW = 600.0  # [s]
SAMPLING_RATE = 40.0  # [Hz]
HIGHEST_FREQUENCY = 30.0  # of the modes that take part [Hz]
MARGIN = 900.0  # cut off: 3.6 time constants of the first mode [s]
START_NS = 1_767_225_600 * NANOSECONDS  # 2026-01-01 UTC


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What the sensors of one acquisition unit read."""

    samples: FloatArray
    """(n_samples, n_channels) [m/s²], channel order of the layout."""
    sampling_rate: float
    """[Hz]"""
    layout: SensorLayout
    """As stated; a fault makes it untrue."""
    start_ns: int = START_NS
    """Sensor clock at the first sample [ns since 1970-01-01 UTC]."""

    def blocks(
        self, duration: float = 1.0, session: str = "outside"
    ) -> Iterator[AccelerationBlock]:
        """Cut the samples into the blocks that an acquisition unit would send."""
        length = round(duration * self.sampling_rate)
        for sequence, first in enumerate(range(0, len(self.samples), length)):
            yield AccelerationBlock(
                turbine=self.layout.turbine,
                unit=self.layout.unit,
                session=session,
                layout_id=self.layout.layout_id,
                sequence=sequence,
                first_sample=first,
                start_ns=self.start_ns + round(first / self.sampling_rate * NANOSECONDS),
                sampling_rate=self.sampling_rate,
                samples=self.samples[first : first + length].astype(np.float32),
            )


def record(
    truth: Truth,
    n_windows: int,
    rng: np.random.Generator,
    *,
    levels: Sequence[float] | None = None,
    layout: SensorLayout = LAYOUT,
    faults: Iterable[SensorFault] = (),
    loads: Loads = STRONG,
    noise_share: float = NOISE_SHARE,
    sampling_rate: float = SAMPLING_RATE,
) -> Record:
    """Draw the time histories of consecutive windows of 600 s.

    Parameters
    ----------
    truth : Truth
        The structure; its `figures.water_level` holds where `levels` is None.
    n_windows : int
        How many windows.
    rng : Generator
        Source of randomness.
    levels : sequence of float, optional
        True sea level of each window above the mean [m]; it steps where a window ends.
    layout : SensorLayout
        DC accelerometers, as stated.
    faults : iterable of SensorFault
        What is wrong with them.
    loads : Loads
        Forces on the structure.
    noise_share : float
        White noise over each channel's rms [-].
    sampling_rate : float
        [Hz]

    Returns
    -------
    Record
    """
    true_levels = [truth.figures.water_level] * n_windows if levels is None else list(levels)
    sensors = instruments(layout, faults)
    pieces = []
    for level, count in _runs(true_levels):
        modes = truth.modes(level, highest_frequency=HIGHEST_FREQUENCY)
        length = round(count * WINDOW * sampling_rate)
        pieces.append(_response(modes, sensors.true, loads, length, sampling_rate, rng))
    samples = np.concatenate(pieces)
    noise = noise_share * samples.std(axis=0) * rng.standard_normal(samples.shape)
    return Record((samples + noise) * sensors.gains, sampling_rate, layout)


def write_npz(made: Record, folder: Path) -> tuple[Path, Path]:
    """Write `record.npz` and `layout.toml`, which `pilewatch import` takes; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    times = made.start_ns * 1e-9 + np.arange(len(made.samples)) / made.sampling_rate
    series = dict(zip(made.layout.channel_names, made.samples.T, strict=True))
    np.savez(folder / "record.npz", time=times, **series)
    return folder / "record.npz", _write_layout(made.layout, folder)


def write_csv(made: Record, folder: Path) -> tuple[Path, Path]:
    """Write `record.csv` and `layout.toml`; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    times = np.arange(len(made.samples)) / made.sampling_rate
    np.savetxt(
        folder / "record.csv",
        np.column_stack([times, made.samples]),
        fmt=["%.4f"] + ["%.7g"] * made.samples.shape[1],
        delimiter=",",
        header=",".join(["time [s]", *(f"{name} [m/s^2]" for name in made.layout.channel_names)]),
        comments="",
    )
    return folder / "record.csv", _write_layout(made.layout, folder)


def _write_layout(layout: SensorLayout, folder: Path) -> Path:
    lines = [f'turbine = "{layout.turbine}"', f'unit = "{layout.unit}"']
    for axis in layout.channels:
        lines += [
            "",
            "[[channels]]",
            f'name = "{axis.name}"',
            f"elevation = {axis.elevation}",
            f"direction = {list(axis.direction)}",
        ]
    path = folder / "layout.toml"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def _runs(levels: Sequence[float]) -> list[tuple[float, int]]:
    """Consecutive windows of one level as (level, how many)."""
    runs: list[tuple[float, int]] = []
    for level in levels:
        if runs and runs[-1][0] == level:
            runs[-1] = (level, runs[-1][1] + 1)
        else:
            runs.append((level, 1))
    return runs


def _response(
    modes: Modes,
    layout: SensorLayout,
    loads: Loads,
    length: int,
    sampling_rate: float,
    rng: np.random.Generator,
) -> FloatArray:
    """(length, n_channels): what DC accelerometers read, u'' − g ψ [m/s²]."""
    n = next_fast_len(length + round(MARGIN * sampling_rate), real=True)
    frequencies = rfftfreq(n, 1 / sampling_rate)
    white = white_rows(modes.structure, loads) @ modes.vectors
    waves = wave_rows(modes.structure, loads) @ modes.vectors
    amplitude = np.sqrt(n * sampling_rate / 4)  # of a coefficient's two parts per unit of √G
    force = _coefficients(rng, len(white), len(frequencies)).T @ white / np.sqrt(BAND)
    swell = _coefficients(rng, len(waves), len(frequencies)).T @ waves
    force += np.sqrt(wave_spectrum(frequencies))[:, None] * swell
    omega, own = 2 * np.pi * frequencies[:, None], 2 * np.pi * modes.frequencies
    force *= amplitude / (own**2 - omega**2 + 2j * DAMPING * own * omega)
    rows = [modes.structure.axis_rows(axis) for axis in layout.channels]
    displacement, slope = (np.array([row[i] for row in rows]) @ modes.vectors for i in (0, 1))
    spectrum = -(omega**2) * (force @ displacement.T)
    spectrum -= modes.structure.description.gravity * (force @ slope.T)
    spectrum[0] = 0.0
    return np.asarray(irfft(spectrum, n, axis=0)[:length])


def _coefficients(rng: np.random.Generator, n_series: int, n_frequencies: int) -> ComplexArray:
    """(n_series, n_frequencies): real and imaginary parts of unit variance."""
    return rng.standard_normal((n_series, n_frequencies, 2)).view(np.complex128)[..., 0]
