"""SimulatedTower: loads → response → noisy blocks, as one acquisition unit would send them."""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition import Decimator, Instruments, MountedAxes, quantised
from sensors.blocks import NANOSECONDS, AccelerationBlock
from sensors.course import Course, FoundationCourse, Stage, Tide
from sensors.errors import InputError
from sensors.faults import Fault, with_faults
from sensors.layout import SensorLayout
from sensors.loads import (
    BroadbandLoad,
    Load,
    RandomStream,
    Rotor,
    Sea,
    SeaState,
    WaveBandLoad,
    Wind,
    generator,
    random_loads,
    rotor_load,
    wave_load,
    wind_load,
)
from sensors.scada import ScadaSample, scada_samples
from sensors.simulated_structure import ChangingStructure
from sensors.turbine.assembly import StructuralModel
from sensors.turbine.damped_response import DampedResponse
from sensors.turbine.description import TurbineDescription, load_turbine
from sensors.turbine.foundation import FoundationSprings, positive_definite
from sensors.turbine.response import AccelerationResponse
from sensors.turbine.structure_modes import ModalDamping, StructureModes
from sensors.units import UnitSettings, read_by_units, unit_layouts

FloatArray = NDArray[np.float64]

LOWEST_INTEGRATION_RATE = 120.0  # [Hz]: loads and response hold the band to 60 Hz
SPECTRUM_CHUNK = 256  # frequencies at a time, to stay in the processor's cache
CHUNK_DURATION = 60.0  # [s] integrated at a time; fixed, so that the blocks do not change it


class SimulationError(InputError):
    """A simulation that cannot be run; the message names the setting and its value."""


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """What is simulated: how long, under which loads, seen by which instruments.

    `wind` and `sea` follow from their physics; `broadband` and `waves` have a stated rms. Any of
    them may act together. `stages`, `foundation` and `tide` say what changes with time.
    """

    duration: float = 3600.0  # [s]
    seed: int = 1
    stiffness_ratios: tuple[float, float, float] = (1.0, 1.0, 1.0)  # true k11, k22, k12 / nominal
    damping: ModalDamping = field(default_factory=ModalDamping)
    broadband: BroadbandLoad = field(default_factory=BroadbandLoad)
    waves: WaveBandLoad = field(default_factory=WaveBandLoad)
    wind: Wind | None = None
    sea: Sea | None = None
    rotor: Rotor = field(default_factory=Rotor)  # where a stage makes it turn
    stages: tuple[Stage, ...] = ()  # of weather and operation
    foundation: FoundationCourse = field(default_factory=FoundationCourse)
    tide: Tide = field(default_factory=Tide)
    structure: str = ""  # a description that differs from the updater's; empty: the same
    transient: float = 600.0  # simulated from rest and dropped before the first sample [s]
    sampling_rate: float = 40.0  # [Hz]
    block_duration: float = 1.0  # [s]
    noise_share: float = 0.03  # of each channel's rms by linear theory, white [-]
    instruments: Instruments = field(default_factory=Instruments)
    faults: tuple[Fault, ...] = ()
    units: tuple[UnitSettings, ...] = ()  # acquisition units; empty: one reads every channel
    scada_period: float = 0.0  # between two SCADA samples [s]; 0: there are none
    quantisation_step: float = 2.0**-12  # [m/s²]: 16 bits over ±8 m/s²; 0: no converter
    start_ns: int = 1_767_225_600 * NANOSECONDS  # sensor clock at the first sample: 2026-01-01
    session: str = ""  # empty: "simulated-" and the seed
    tube_refinement: int = 2  # elements in each of the description's tubes

    def __post_init__(self) -> None:
        for name in ("duration", "sampling_rate", "block_duration"):
            if not getattr(self, name) > 0:
                raise SimulationError(f"{name} is {getattr(self, name):g}; it must be positive")
        for name in ("transient", "noise_share", "quantisation_step", "scada_period"):
            if not getattr(self, name) >= 0:
                raise SimulationError(f"{name} is {getattr(self, name):g}; it must be 0 or more")
        if self.seed < 0:
            raise SimulationError(f"seed is {self.seed}; it must be 0 or more")
        if abs(self.block_duration * self.sampling_rate - self.samples_per_block) > 1e-6:
            raise SimulationError(
                f"block_duration is {self.block_duration:g} s; at {self.sampling_rate:g} Hz it "
                "must hold a whole number of samples"
            )
        if self.tube_refinement < 1:
            raise SimulationError(
                f"tube_refinement is {self.tube_refinement}; it must be 1 or more"
            )

        turning = [stage for stage in self.stages if stage.state not in (None, "parked")]
        if turning and self.wind is None:
            raise SimulationError(
                f"the stage at {turning[0].at:g} s is {turning[0].state!r}; a rotor that turns "
                "needs [simulation.wind]"
            )

    @property
    def samples_per_block(self) -> int:
        return max(1, round(self.block_duration * self.sampling_rate))

    @property
    def n_samples(self) -> int:
        """Samples of the session."""
        return round(self.duration * self.sampling_rate)

    @property
    def decimation(self) -> int:
        """Integration steps a sample."""
        return math.ceil(LOWEST_INTEGRATION_RATE / self.sampling_rate - 1e-9)

    @property
    def session_id(self) -> str:
        return self.session or f"simulated-{self.seed}"


class SimulatedTower:
    """A turbine under random loads; iterate for its AccelerationBlocks, from the start.

    The structure is the full finite-element model on `tube_refinement` times the tube elements
    (never the updater's reduced basis), integrated exactly at 120 Hz or a little more, filtered
    and decimated. The blades keep the description's elements. Noise is a share of the rms that
    linear theory gives each channel at the beginning, not of the record's: it does not depend on
    the seed. The same settings give the same samples whatever the block size; memory is flat in
    the duration.
    """

    def __init__(
        self,
        description: TurbineDescription,
        layout: SensorLayout,
        settings: SimulationSettings | None = None,
    ) -> None:
        self.layout = layout
        self.settings = settings = settings or SimulationSettings()
        self.layouts = unit_layouts(layout, settings.units)  # of each acquisition unit
        self._springs = true_springs(description, settings.stiffness_ratios)
        if settings.structure:
            differing = load_turbine(settings.structure)
            description = differing.with_sign(description.foundation.sign)
        self.course = course_of(settings, description)
        self._rate = settings.sampling_rate * settings.decimation
        turns = self.course.yaws or bool(settings.instruments.misalignment)
        self._axes = MountedAxes(layout, settings.instruments.misalignment) if turns else None
        self._structure = ChangingStructure(
            description,
            self._axes.in_nacelle if self._axes else layout,
            springs=self._springs,
            course=self.course,
            damping=settings.damping,
            wind=settings.wind,
            rotor=settings.rotor,
            tube_refinement=settings.tube_refinement,
            highest_frequency=0.5 * self._rate,
        )
        self._loads = loads_on(self._structure.model, settings, self.course, self._rate)
        self._structure.bear(np.concatenate([load.distribution for load in self._loads], axis=1))

    @property
    def truth(self) -> FoundationSprings:
        """The stiffness that the simulated foundation has at the first sample."""
        return self._springs

    def truth_at(self, time: float) -> FoundationSprings:
        """The stiffness at a time [s] without the softening by motion."""
        k11, k22, k12 = (self._springs.stiffness * self.course.stiffness_factors(time)).tolist()
        return FoundationSprings(k11, k22, k12, sign=self._springs.sign)

    @property
    def modes(self) -> StructureModes:
        """Undamped modes at the first sample: the truth of the identification."""
        return self._structure.modes

    def messages(self) -> Iterator[AccelerationBlock | ScadaSample]:
        """Blocks as the link brings them, and SCADA samples, each before the block that it is of.

        Raises FaultError for a fault on a channel that the layout has not.
        """
        settings = self.settings
        blocks: Iterator[AccelerationBlock] = iter(self)
        if settings.units:
            blocks = read_by_units(blocks, self.layout, settings.units)
        if settings.faults:
            rng = generator(settings.seed, RandomStream.FAULTS)
            blocks = with_faults(blocks, settings.faults, self.layouts, rng=rng)
        if settings.scada_period == 0:
            return blocks
        samples = scada_samples(
            self.course,
            turbine=self.layout.turbine,
            start_ns=settings.start_ns,
            period=settings.scada_period,
            duration=settings.duration,
        )
        return in_time(samples, blocks)

    def __iter__(self) -> Iterator[AccelerationBlock]:
        settings, layout = self.settings, self.layout
        size = settings.samples_per_block
        for sequence, samples in enumerate(in_blocks(self.samples(), size)):
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
        """The session's samples as the converter gives them, in pieces of any length.

        Each (n, n_channels) [m/s²].
        """
        settings = self.settings
        noise = generator(settings.seed, RandomStream.SENSOR_NOISE)
        noise_rms = self.noise_rms()
        dropped = round(settings.transient * settings.sampling_rate)
        first = 0
        for readings in trimmed(self.readings(), first=dropped, count=settings.n_samples):
            times = (first + np.arange(len(readings))) / settings.sampling_rate
            first += len(readings)
            if self._axes is not None:
                readings = self._axes.readings(readings, self._yaw(times))
            noisy = readings + noise_rms * noise.standard_normal(readings.shape)
            if settings.instruments.drift_per_hour:
                noisy += settings.instruments.drift(times, noisy.shape[1])
            yield quantised(settings.instruments.limited(noisy), settings.quantisation_step)

    def _yaw(self, times: FloatArray) -> FloatArray:
        return np.array([self.course.figure("yaw", time) for time in times.tolist()])

    def readings(self) -> Iterator[FloatArray]:
        """What perfect accelerometers read at the sampling rate, from rest and without end.

        Each (n, n_channels) [m/s²]; where the axes turn against the nacelle, readings in x and
        then in y of the nacelle at every channel's place.
        """
        response = self._response()
        decimator = Decimator(self.settings.decimation, response.n_channels)
        chunk = round(CHUNK_DURATION * self._rate)
        time, motion = -self.settings.transient, 0.0
        for forces in one_ahead(self._forces(chunk)):
            if isinstance(response, DampedResponse):
                self._structure.update(response, time, motion)
            yield decimator.advance(response.advance(forces))
            time += CHUNK_DURATION
            if isinstance(response, DampedResponse) and self.course.foundation.softening:
                motion = self._structure.mudline_motion(response)

    def _forces(self, chunk: int) -> Iterator[FloatArray]:
        """Of all loads without end, (chunk, n_series) each."""
        series = [load.series(self.settings.seed, chunk) for load in self._loads]
        while True:
            yield np.concatenate([next(one) for one in series], axis=1)

    def _response(self) -> AccelerationResponse | DampedResponse:
        """A new one, at rest; modes one by one where nothing couples or changes them."""
        if self._structure.is_simple:
            return AccelerationResponse(self._structure.observed, self._rate)
        return DampedResponse(self._structure.at(-self.settings.transient), self._rate)

    def readings_per_mode(self, frequencies: FloatArray) -> NDArray[np.complex128]:
        """Reading of each channel per unit harmonic force in each of `modes`, before decimation.

        frequencies   (n_frequencies,) [Hz]
        returns       (n_frequencies, n_channels, n_modes) [m/s² per N/kg^½]
        """
        response = AccelerationResponse(self._structure.observed, self._rate)
        return response.frequency_response(frequencies)

    def spectrum(self, frequencies: FloatArray) -> FloatArray:
        """One-sided spectral density of the readings by linear theory, without noise, at the
        beginning; axes as for `readings`.

        frequencies   up to half the sampling rate, (n_frequencies,) [Hz]
        returns       (n_frequencies, n_channels) [(m/s²)²/Hz]

            S_y(f) = Σ_l H_l(f) S_l(f) H_l(f)ᴴ |D(f)|²,   H the recursion's own response, D the
            filter's, S_l the cross-spectrum of the linear part of load l
        """
        response = self._response()
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
            variances = self._axes.variances(variances, self.course.figure("yaw", 0.0))
        return np.sqrt(variances)

    def noise_rms(self) -> FloatArray:
        """Standard deviation of each channel's white noise, (n_channels,) [m/s²]."""
        settings = self.settings
        share = np.zeros(len(self.layout.channels))
        if settings.noise_share > 0:
            share = settings.noise_share * self.stationary_rms()
        white = settings.instruments.noise_deviation(settings.sampling_rate)
        return np.hypot(share, white) if white else share


def course_of(settings: SimulationSettings, description: TurbineDescription) -> Course:
    """What of a simulation depends on time alone."""
    water, sea, wind = description.water, settings.sea, settings.wind
    return Course(
        stages=settings.stages,
        foundation=settings.foundation,
        tide=settings.tide,
        mean_level=0.0 if water is None else water.level,
        wind_speed=wind.speed if wind else Wind().speed,
        significant_wave_height=sea.significant_wave_height if sea else 0.0,
        peak_period=sea.peak_period if sea else Sea().peak_period,
    )


def loads_on(
    model: StructuralModel, settings: SimulationSettings, course: Course, rate: float
) -> tuple[Load, ...]:
    """Every load of a simulation as series at the integration's rate [Hz].

    Raises SimulationError where there is none.
    """
    loads: list[Load] = list(
        random_loads(model, broadband=settings.broadband, waves=settings.waves, sampling_rate=rate)
    )
    begin = {"sampling_rate": rate, "start": -settings.transient}

    def wind_speed(time: float) -> float:
        return course.figure("wind_speed", time)

    def sea_state(time: float) -> SeaState:
        assert settings.sea is not None
        return SeaState(
            significant_wave_height=course.figure("significant_wave_height", time),
            peak_period=course.figure("peak_period", time),
            level=course.level(time),
            direction=settings.sea.direction - course.figure("yaw", time),
        )

    if settings.sea is not None:
        levels = {
            "highest_level": course.highest_level,
            "largest_height": course.largest("significant_wave_height"),
        }
        loads.append(wave_load(model, settings.sea, sea_state, **levels, **begin))
    if settings.wind is not None:
        loads.append(wind_load(model, settings.wind, wind_speed, **begin))
        if course.turns:
            loads.append(
                rotor_load(
                    model,
                    settings.rotor,
                    settings.wind,
                    steady_at=course.rotor,
                    speed_at=wind_speed,
                    **begin,
                )
            )
    if not loads:
        raise SimulationError(
            "every load is 0 N; at least one of broadband tower_rms, blade_rms, waves "
            "fore_aft_rms, side_side_rms must be positive, or [simulation.wind] or "
            "[simulation.sea] be there"
        )
    return tuple(loads)


def in_time(
    samples: Iterator[ScadaSample], blocks: Iterator[AccelerationBlock]
) -> Iterator[AccelerationBlock | ScadaSample]:
    """Both streams in one; a SCADA sample comes before the block during which it was taken."""
    waiting = next(samples, None)
    for block in blocks:
        while waiting is not None and waiting.time_ns < block.end_ns:
            yield waiting
            waiting = next(samples, None)
        yield block
    while waiting is not None:
        yield waiting
        waiting = next(samples, None)


def true_springs(
    description: TurbineDescription, ratios: tuple[float, float, float]
) -> FoundationSprings:
    """The description's springs times the ratios of k11, k22, k12.

    Raises SimulationError where the product is not positive definite.
    """
    k11, k22, k12 = (description.nominal * np.array(ratios)).tolist()
    if not bool(positive_definite((k11, k22, k12))):
        raise SimulationError(
            f"stiffness_ratios {', '.join(f'{ratio:g}' for ratio in ratios)} of {description.name} "
            "are not positive definite; k11, k22 > 0 and k12 < sqrt(k11·k22) are needed"
        )
    return FoundationSprings(k11, k22, k12, sign=description.foundation.sign)


def resonance_grid(modes: StructureModes, highest_frequency: float) -> FloatArray:
    """Rising frequencies up to a limit that resolve every resonance for integration [Hz].

    Even steps of 0.01 Hz (0.001 Hz in the wave band), and round each mode points spaced like
    tan(x) in half-bandwidths ζf, on which the trapezoid rule integrates a resonance curve exactly.
    """
    spread = np.tan(np.linspace(-0.5, 0.5, 49) * np.pi * 0.995)
    near = modes.frequencies[:, None] * (1.0 + modes.damping_ratios[:, None] * spread)
    even = np.concatenate([np.arange(0.0, 1.0, 0.001), np.arange(1.0, highest_frequency, 0.01)])
    grid = np.concatenate([even, near.ravel(), [highest_frequency]])
    return np.unique(grid[(grid >= 0.0) & (grid <= highest_frequency)])


def trimmed(pieces: Iterator[FloatArray], *, first: int, count: int) -> Iterator[FloatArray]:
    """Samples first to first + count of a stream that comes in pieces, (n, n_channels) each."""
    to_skip, wanted = first, count
    while wanted > 0:
        piece = next(pieces)
        kept = piece[to_skip : to_skip + wanted]
        to_skip = max(0, to_skip - len(piece))
        wanted -= len(kept)
        if len(kept):
            yield kept


def one_ahead(pieces: Iterator[FloatArray]) -> Iterator[FloatArray]:
    """An endless stream, its next piece made in another thread while this one is worked on."""
    with ThreadPoolExecutor(1, thread_name_prefix="loads") as pool:
        following = pool.submit(next, pieces)
        while True:
            piece = following.result()
            following = pool.submit(next, pieces)
            yield piece


def in_blocks(pieces: Iterator[NDArray[np.float32]], size: int) -> Iterator[NDArray[np.float32]]:
    """The stream cut into blocks of `size` samples; the last one may be shorter."""
    held: NDArray[np.float32] | None = None
    for piece in pieces:
        held = piece if held is None else np.concatenate([held, piece])
        whole = len(held) // size * size
        yield from (held[start : start + size] for start in range(0, whole, size))
        held = held[whole:]
    if held is not None and len(held):
        yield held
