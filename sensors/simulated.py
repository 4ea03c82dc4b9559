"""SimulatedTower: loads → response → noisy blocks, as one acquisition unit would send them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition import Decimator, quantised
from sensors.blocks import NANOSECONDS, AccelerationBlock
from sensors.errors import InputError
from sensors.layout import SensorLayout
from sensors.loads import (
    BroadbandLoad,
    RandomStream,
    WaveBandLoad,
    generator,
    random_loads,
)
from sensors.turbine.assembly import assemble
from sensors.turbine.description import TurbineDescription
from sensors.turbine.foundation import FoundationSprings, positive_definite
from sensors.turbine.response import (
    AccelerationResponse,
    ModalDamping,
    StructureModes,
    observed_modes,
    structure_modes,
)

FloatArray = NDArray[np.float64]

LOWEST_INTEGRATION_RATE = 120.0  # [Hz]: loads and response hold the band to 60 Hz
SPECTRUM_CHUNK = 256  # frequencies at a time, to stay in the processor's cache
CHUNK_DURATION = 60.0  # [s] integrated at a time; fixed, so that the blocks do not change it


class SimulationError(InputError):
    """A simulation that cannot be run; the message names the setting and its value."""


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """What is simulated: how long, under which loads, seen by which instruments."""

    duration: float = 3600.0  # [s]
    seed: int = 1
    stiffness_ratios: tuple[float, float, float] = (1.0, 1.0, 1.0)  # true k11, k22, k12 / nominal
    damping: ModalDamping = field(default_factory=ModalDamping)
    broadband: BroadbandLoad = field(default_factory=BroadbandLoad)
    waves: WaveBandLoad = field(default_factory=WaveBandLoad)
    transient: float = 600.0  # simulated from rest and dropped before the first sample [s]
    sampling_rate: float = 40.0  # [Hz]
    block_duration: float = 1.0  # [s]
    noise_share: float = 0.03  # of each channel's rms, white [-]
    quantisation_step: float = 2.0**-12  # [m/s²]: 16 bits over ±8 m/s²; 0: no converter
    start_ns: int = 1_767_225_600 * NANOSECONDS  # sensor clock at the first sample: 2026-01-01
    session: str = ""  # empty: "simulated-" and the seed
    tube_refinement: int = 2  # elements in each of the description's tubes

    def __post_init__(self) -> None:
        for name in ("duration", "sampling_rate", "block_duration"):
            if not getattr(self, name) > 0:
                raise SimulationError(f"{name} is {getattr(self, name):g}; it must be positive")
        for name in ("transient", "noise_share", "quantisation_step"):
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
    """A parked turbine under random loads; iterate for its AccelerationBlocks, from the start.

    The structure is the full finite-element model on `tube_refinement` times the tube elements
    (never the updater's reduced basis), integrated exactly at 120 Hz or a little more, filtered
    and decimated. The blades keep the description's elements. Noise is a share of the rms that
    theory gives each channel, not of the record's: it does not depend on the seed.
    The same settings give the same samples whatever the block size; memory is flat in the duration.
    """

    def __init__(
        self,
        description: TurbineDescription,
        layout: SensorLayout,
        settings: SimulationSettings | None = None,
    ) -> None:
        self.layout = layout
        self.settings = settings or SimulationSettings()
        self._springs = true_springs(description, self.settings.stiffness_ratios)
        self._model = assemble(
            description,
            stiffness=self._springs.stiffness,
            tube_refinement=self.settings.tube_refinement,
        )
        self._rate = self.settings.sampling_rate * self.settings.decimation
        self._loads = random_loads(
            self._model,
            broadband=self.settings.broadband,
            waves=self.settings.waves,
            sampling_rate=self._rate,
        )
        if not self._loads:
            raise SimulationError(
                "every load is 0 N; at least one of broadband tower_rms, blade_rms and waves "
                "fore_aft_rms, side_side_rms must be positive"
            )
        self._modes = structure_modes(
            self._model, self.settings.damping, highest_frequency=0.5 * self._rate
        )
        distribution = np.concatenate([load.distribution for load in self._loads], axis=1)
        self._observed = observed_modes(self._model, self._modes, layout, distribution)

    @property
    def truth(self) -> FoundationSprings:
        """The stiffness that the simulated foundation has."""
        return self._springs

    @property
    def modes(self) -> StructureModes:
        """Modes of the simulated structure: the truth of the identification."""
        return self._modes

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
        for readings in trimmed(self.readings(), first=dropped, count=settings.n_samples):
            noisy = readings + noise_rms * noise.standard_normal(readings.shape)
            yield quantised(noisy, settings.quantisation_step)

    def readings(self) -> Iterator[FloatArray]:
        """What perfect accelerometers read at the sampling rate, from rest and without end.

        Each (n, n_channels) [m/s²].
        """
        response = AccelerationResponse(self._observed, self._rate)
        decimator = Decimator(self.settings.decimation, response.n_channels)
        chunk = round(CHUNK_DURATION * self._rate)
        series = [load.series(self.settings.seed, chunk) for load in self._loads]
        while True:
            forces = np.concatenate([next(one) for one in series], axis=1)
            yield decimator.advance(response.advance(forces))

    def readings_per_mode(self, frequencies: FloatArray) -> NDArray[np.complex128]:
        """Reading of each channel per unit harmonic force in each of `modes`, before decimation.

        frequencies   (n_frequencies,) [Hz]
        returns       (n_frequencies, n_channels, n_modes) [m/s² per N/kg^½]
        """
        return AccelerationResponse(self._observed, self._rate).frequency_response(frequencies)

    def spectrum(self, frequencies: FloatArray) -> FloatArray:
        """One-sided spectral density of the readings by theory, without noise.

        frequencies   up to half the sampling rate, (n_frequencies,) [Hz]
        returns       (n_frequencies, n_channels) [(m/s²)²/Hz]

            S_y(f) = Σ_l |H_l(f)|² S_l(f) |D(f)|²,   H the recursion's own response, D the filter's
        """
        response = AccelerationResponse(self._observed, self._rate)
        decimator = Decimator(self.settings.decimation, response.n_channels)
        series = np.cumsum([load.n_series for load in self._loads])[:-1]
        participations = np.split(self._observed.participation, series, axis=1)
        densities = np.array([load.spectrum(frequencies) for load in self._loads])
        spectrum = np.empty((len(frequencies), response.n_channels))
        for start in range(0, len(frequencies), SPECTRUM_CHUNK):
            part = slice(start, start + SPECTRUM_CHUNK)
            per_mode = response.frequency_response(frequencies[part])
            gains = np.stack([_power(per_mode @ own) for own in participations])
            spectrum[part] = np.einsum("lfc,lf->fc", gains, densities[:, part])
        return spectrum * decimator.gain(frequencies, self._rate)[:, None] ** 2

    def stationary_rms(self) -> FloatArray:
        """Root mean square of the readings by theory, (n_channels,) [m/s²]."""
        grid = resonance_grid(self._modes, 0.5 * self.settings.sampling_rate)
        return np.sqrt(np.trapezoid(self.spectrum(grid), grid, axis=0))

    def noise_rms(self) -> FloatArray:
        """Standard deviation of each channel's white noise, (n_channels,) [m/s²]."""
        share = self.settings.noise_share
        return share * self.stationary_rms() if share > 0 else np.zeros(len(self.layout.channels))


def _power(gains: NDArray[np.complex128]) -> FloatArray:
    """Σ |gain|² over the independent series on the last axis."""
    return (gains.real**2 + gains.imag**2).sum(axis=-1)


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
