"""SimulatedTower: loads → response → noisy blocks, as one acquisition unit would send them."""

import math
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.dynamics.damped_modes import DampedSystem
from sensors.dynamics.responses.damped_response import DampedResponse
from sensors.dynamics.responses.modal_response import AccelerationResponse
from sensors.dynamics.simulated_modes import StructureModes
from sensors.loads import RandomStream, generator
from sensors.simulation.acquisition_units import read_by_units, unit_layouts
from sensors.simulation.faults import require_known, with_faults
from sensors.simulation.instruments import Decimator, MountedAxes, quantise
from sensors.simulation.loads_over_time import build_loads, build_schedule, true_springs
from sensors.simulation.schedule import scada_samples
from sensors.simulation.settings import (
    LOWEST_INTEGRATION_RATE,
    SimulationError,
    SimulationSettings,
)
from sensors.simulation.structure_over_time import ChangingStructure, rms_motion
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import FoundationSprings

__all__ = [
    "LOWEST_INTEGRATION_RATE",
    "SimulatedTower",
    "SimulationError",
    "SimulationSettings",
    "resonance_grid",
]


SPECTRUM_CHUNK = 256  # frequencies at a time, to stay in the processor's cache
CHUNK_DURATION = 60.0  # [s] integrated at a time; fixed, so that the blocks do not change it
ON_A_STEP = 1e-9  # distance from a step of the integration that counts as none [steps]
CHUNKS_AHEAD = 8  # of each load: a wind or a sea is drawn ten chunks at once meanwhile


class SimulatedTower:
    """A turbine under random loads; iterate for its AccelerationBlocks, from the start.

    The structure is the full finite-element model on `tube_refinement` times the tube elements
    (never the updater's reduced basis), integrated exactly at 120 Hz or a little more, filtered
    and decimated. The blades keep the description's elements. Noise is a share of the rms that
    linear theory gives each channel at the beginning, not of the record's: it does not depend on
    the seed. The same settings give the same samples whatever the block size and `chunks_ahead`,
    the minutes of each load that are drawn ahead; memory is flat in the duration.

    Raises
    ------
    SimulationError, UnitError, FaultError
        For settings that do not fit the structure or the layout.
    """

    def __init__(
        self,
        description: TurbineDescription,
        layout: SensorLayout,
        settings: SimulationSettings | None = None,
        *,
        chunks_ahead: int = CHUNKS_AHEAD,
    ) -> None:
        self.layout = layout
        self._chunks_ahead = chunks_ahead
        self.settings = settings = settings or SimulationSettings()
        self.layouts = unit_layouts(layout, settings.units)  # of each acquisition unit
        require_known(settings.faults, self.layouts)
        self._springs = true_springs(description, settings.stiffness_ratios)
        if settings.structure:
            differing = load_turbine(settings.structure)
            description = differing.with_sign(description.foundation.sign)
        self.schedule = build_schedule(settings, description)
        self._rate = settings.sampling_rate * settings.decimation
        turns = self.schedule.yaws or bool(settings.instruments.misalignment)
        self._axes = MountedAxes(layout, settings.instruments.misalignment) if turns else None
        self._structure = ChangingStructure(
            description,
            self._axes.in_nacelle if self._axes else layout,
            springs=self._springs,
            schedule=self.schedule,
            damping=settings.damping,
            wind=settings.wind,
            rotor=settings.rotor,
            tube_refinement=settings.tube_refinement,
            highest_frequency=0.5 * self._rate,
        )
        self._loads = build_loads(self._structure.model, settings, self.schedule, self._rate)
        self._structure.bear(np.concatenate([load.distribution for load in self._loads], axis=1))

    @property
    def truth(self) -> FoundationSprings:
        """The stiffness that the simulated foundation has at the first sample."""
        return self._springs

    def truth_at(self, time: float) -> FoundationSprings:
        """Return the stiffness at a time [s] without the softening by motion."""
        k11, k22, k12 = (self._springs.stiffness * self.schedule.stiffness_factors(time)).tolist()
        return FoundationSprings(k11, k22, k12, sign=self._springs.sign)

    @property
    def modes(self) -> StructureModes:
        """Undamped modes at the first sample."""
        return self._structure.modes

    @property
    def system(self) -> DampedSystem:
        """The modal model at the first sample, with the air's damping."""
        return self._structure.at(0.0)

    def messages(self) -> Iterator[AccelerationBlock | ScadaSample]:
        """Blocks as the link brings them, and SCADA samples, each before the block it is of."""
        settings = self.settings
        blocks: Iterator[AccelerationBlock] = iter(self)
        if settings.units:
            blocks = read_by_units(blocks, self.layout, settings.units)
        if settings.faults:
            rng = generator(settings.seed, RandomStream.FAULTS)
            blocks = with_faults(blocks, settings.faults, self.layouts, settings.units, rng=rng)
        if settings.scada_period == 0:
            return blocks
        samples = scada_samples(
            self.schedule,
            turbine=self.layout.turbine,
            start_ns=settings.start_ns,
            period=settings.scada_period,
            duration=settings.duration,
        )
        return merge_by_time(samples, blocks)

    def __iter__(self) -> Iterator[AccelerationBlock]:
        settings, layout = self.settings, self.layout
        size = settings.samples_per_block
        for sequence, samples in enumerate(split_into_blocks(self.samples(), size)):
            first = sequence * size
            yield AccelerationBlock(
                turbine=layout.turbine,
                unit=layout.unit,
                session=settings.session_id,
                layout_id=layout.layout_id,
                sequence=sequence,
                first_sample=first,
                start_ns=settings.start_ns + round(first / settings.sampling_rate * NANOSECONDS),
                sampling_rate=settings.sampling_rate,
                samples=samples,
            )

    def samples(self) -> Iterator[NDArray[np.float32]]:
        """Yield the session's samples as the converter gives them, in chunks of any length.

        Each (n, n_channels) [m/s²].
        """
        settings = self.settings
        noise = generator(settings.seed, RandomStream.SENSOR_NOISE)
        noise_rms = self.noise_rms()
        dropped = round(settings.transient * settings.sampling_rate)
        first = 0
        needed = self.readings(settings.transient + settings.duration)
        for readings in trim(needed, first=dropped, count=settings.n_samples):
            times = (first + np.arange(len(readings))) / settings.sampling_rate
            first += len(readings)
            if self._axes is not None:
                readings = self._axes.readings(readings, self._yaw(times))
            noisy = readings + noise_rms * noise.standard_normal(readings.shape)
            if settings.instruments.drift_per_hour:
                noisy += settings.instruments.drift(times, noisy.shape[1])
            yield quantise(settings.instruments.limited(noisy), settings.quantisation_step)

    def _yaw(self, times: FloatArray) -> FloatArray:
        return np.array([self.schedule.figure("yaw", time) for time in times.tolist()])

    def readings(self, duration: float | None = None) -> Iterator[FloatArray]:
        """Yield what perfect accelerometers read at the sampling rate, from rest.

        Parameters
        ----------
        duration : float, optional
            Duration that is needed at least [s]; None: without end.

        Yields
        ------
        ndarray, shape (n, n_channels)
            [m/s²]; where the axes turn against the nacelle, readings in x and then in y of the
            nacelle at every channel's place.
        """
        response = self.response()
        decimator = Decimator(self.settings.decimation, response.n_channels)
        chunk = round(CHUNK_DURATION * self._rate)
        later = math.ceil((decimator.delay + self.settings.decimation) / chunk)
        n_chunks = None if duration is None else int(duration * self._rate // chunk) + 1 + later
        motion = 0.0
        for number, forces in enumerate(self._forces(chunk, n_chunks)):
            if isinstance(response, DampedResponse):
                time = number * chunk / self._rate - self.settings.transient
                readings, motion = self._advance(response, forces, time, motion)
            else:
                readings = response.advance(forces)
            yield decimator.advance(readings)

    def _advance(
        self, response: DampedResponse, forces: FloatArray, time: float, motion: float
    ) -> tuple[FloatArray, float]:
        """Return the readings of a chunk from a time [s] on, and the mudline's motion, rms [m].

        The structure goes with the time at the chunk's beginning, and at each sudden change of the
        foundation during it.
        """
        begins = {0: time}
        for event in sorted(self.schedule.foundation.events, key=lambda each: each.at):
            step = math.ceil((event.at - time) * self._rate - ON_A_STEP)
            if 0 <= step < len(forces):
                begins[step] = max(event.at, begins.get(step, time))
        readings, mudline = [], []
        for part, instant in zip(np.split(forces, list(begins)[1:]), begins.values(), strict=True):
            self._structure.update(response, instant, motion)
            readings.append(response.advance(part))
            if self.schedule.foundation.softening:
                mudline.append(self._structure.mudline(response))
        return np.concatenate(readings), rms_motion(mudline) if mudline else 0.0

    def _forces(self, chunk: int, n_chunks: int | None) -> Iterator[FloatArray]:
        """Yield the forces of all loads, (chunk, n_series) each; a thread makes each load."""
        with ExitStack() as threads:
            series = []
            for load in self._loads:
                own = islice(load.series(self.settings.seed, chunk), n_chunks)
                series.append(threads.enter_context(closing(prefetch(own, self._chunks_ahead))))
            for parts in zip(*series, strict=True):
                yield np.concatenate(parts, axis=1)

    def response(self) -> AccelerationResponse | DampedResponse:
        """Return the integrator, at rest.

        Modes one by one where nothing couples or changes them.
        """
        if self._structure.is_simple:
            return AccelerationResponse(self._structure.observed, self._rate)
        return DampedResponse(self._structure.at(-self.settings.transient), self._rate)

    def spectrum(self, frequencies: FloatArray) -> FloatArray:
        """Return the one-sided spectral density of the readings by linear theory, without noise.

        It is that at the beginning; axes as for `readings`.

        Parameters
        ----------
        frequencies : ndarray, shape (n_frequencies,)
            Up to half the sampling rate [Hz].

        Returns
        -------
        ndarray, shape (n_frequencies, n_channels)
            [(m/s²)²/Hz].

        Notes
        -----
            S_y(f) = Σ_l H_l(f) S_l(f) H_l(f)ᴴ |D(f)|²,   H the recursion's own response, D the
            filter's, S_l the cross-spectrum of the linear part of load l
        """
        response = self.response()
        decimator = Decimator(self.settings.decimation, response.n_channels)
        columns = np.cumsum([load.n_series for load in self._loads])[:-1]
        spectrum = np.zeros((len(frequencies), response.n_channels))
        for start in range(0, len(frequencies), SPECTRUM_CHUNK):
            part = slice(start, start + SPECTRUM_CHUNK)
            gains = np.split(response.gains(frequencies[part]), columns, axis=2)
            for load, own in zip(self._loads, gains, strict=True):
                spectrum[part] += load.response_spectrum(frequencies[part], own)
        return spectrum * decimator.gain(frequencies, self._rate)[:, None] ** 2

    def stationary_rms(self) -> FloatArray:
        """Root mean square of the channels' readings by linear theory, (n_channels,) [m/s²]."""
        grid = resonance_grid(self.modes, 0.5 * self.settings.sampling_rate)
        variances: FloatArray = np.asarray(np.trapezoid(self.spectrum(grid), grid, axis=0))
        if self._axes is not None:  # fore-aft and side-side taken as independent
            variances = self._axes.variances(variances, self.schedule.figure("yaw", 0.0))
        return np.sqrt(variances)

    def noise_rms(self) -> FloatArray:
        """Standard deviation of each channel's white noise, (n_channels,) [m/s²]."""
        settings = self.settings
        share = np.zeros(len(self.layout.channels))
        if settings.noise_share > 0:
            share = settings.noise_share * self.stationary_rms()
        white = settings.instruments.noise_deviation(settings.sampling_rate)
        return np.hypot(share, white) if white else share


def resonance_grid(modes: StructureModes, highest_frequency: float) -> FloatArray:
    """Rising frequencies up to a limit that resolve every resonance for integration [Hz].

    Parameters
    ----------
    modes : StructureModes
        With frequencies [Hz] and damping ratios [-].
    highest_frequency : float
        The limit [Hz].

    Notes
    -----
    Even steps of 0.01 Hz (0.001 Hz in the wave band), and round each mode points spaced like
    tan(x) in half-bandwidths ζf, on which the trapezoid rule integrates a resonance curve exactly.
    """
    spread = np.tan(np.linspace(-0.5, 0.5, 49) * np.pi * 0.995)
    near = modes.frequencies[:, None] * (1.0 + modes.damping_ratios[:, None] * spread)
    even = np.concatenate([np.arange(0.0, 1.0, 0.001), np.arange(1.0, highest_frequency, 0.01)])
    grid = np.concatenate([even, near.ravel(), [highest_frequency]])
    return np.unique(grid[(grid >= 0.0) & (grid <= highest_frequency)])


def merge_by_time(
    samples: Iterator[ScadaSample], blocks: Iterator[AccelerationBlock]
) -> Iterator[AccelerationBlock | ScadaSample]:
    """Yield both streams in one.

    A SCADA sample comes before the block during which it was taken.
    """
    waiting = next(samples, None)
    for block in blocks:
        while waiting is not None and waiting.time_ns < block.end_ns:
            yield waiting
            waiting = next(samples, None)
        yield block
    while waiting is not None:
        yield waiting
        waiting = next(samples, None)


def trim(chunks: Iterator[FloatArray], *, first: int, count: int) -> Iterator[FloatArray]:
    """Samples first to first + count of a stream of chunks, (n, n_channels) each."""
    to_skip, wanted = first, count
    while wanted > 0:
        chunk = next(chunks)
        kept = chunk[to_skip : to_skip + wanted]
        to_skip = max(0, to_skip - len(chunk))
        wanted -= len(kept)
        if len(kept):
            yield kept


def prefetch(chunks: Iterator[FloatArray], depth: int) -> Generator[FloatArray]:
    """Yield a stream whose next `depth` chunks are made in another thread while one is used.

    Closed early, it makes no further chunk than the one that is being made.
    """
    pool = ThreadPoolExecutor(1, thread_name_prefix="loads")
    try:
        waiting = deque(pool.submit(next, chunks, None) for _ in range(depth))
        while (chunk := waiting.popleft().result()) is not None:
            waiting.append(pool.submit(next, chunks, None))
            yield chunk
    finally:
        pool.shutdown(cancel_futures=True)


def split_into_blocks(
    chunks: Iterator[NDArray[np.float32]], size: int
) -> Iterator[NDArray[np.float32]]:
    """Yield the stream cut into blocks of `size` samples; the last one may be shorter."""
    held: NDArray[np.float32] | None = None
    for chunk in chunks:
        held = chunk if held is None else np.concatenate([held, chunk])
        whole = len(held) // size * size
        yield from (held[start : start + size] for start in range(0, whole, size))
        held = held[whole:]
    if held is not None and len(held):
        yield held
