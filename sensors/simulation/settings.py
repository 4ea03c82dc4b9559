"""What is simulated: a scenario's [simulation], checked at the door."""

import math
from dataclasses import dataclass, field

from sensors.acquisition.blocks import NANOSECONDS
from sensors.dynamics.simulated_modes import ModalDamping
from sensors.errors import InputError
from sensors.loads import BroadbandLoad, Rotor, Sea, WaveBandLoad, Wind
from sensors.settings import NO_KEY
from sensors.simulation.acquisition_units import UnitSettings
from sensors.simulation.faults import Fault
from sensors.simulation.instruments import Instruments
from sensors.simulation.schedule import FoundationSchedule, ScheduleStep, Tide

LONGEST_DURATION = 3.15576e9  # a hundred years; stamps in ns reach twice as far [s]
LOWEST_INTEGRATION_RATE = 120.0  # [Hz]: loads and response hold the band to 60 Hz


class SimulationError(InputError):
    """A simulation that cannot be run; the message names the setting and its value."""


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """What is simulated: how long, under which loads, seen by which instruments.

    `wind` and `sea` follow from their physics; `broadband` and `waves` have a stated rms. Any of
    them may act together. `stages`, `foundation` and `tide` state what changes with time.
    """

    duration: float = 3600.0
    """Duration [s]."""

    seed: int = field(default=1, metadata=NO_KEY)
    stiffness_ratios: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """True k11, k22, k12 / nominal."""

    damping: ModalDamping = field(default_factory=ModalDamping)
    broadband: BroadbandLoad = field(default_factory=BroadbandLoad)
    waves: WaveBandLoad = field(default_factory=WaveBandLoad)
    wind: Wind | None = None
    sea: Sea | None = None
    rotor: Rotor = field(default_factory=Rotor)
    """Forces of the rotor while a step makes it turn."""

    stages: tuple[ScheduleStep, ...] = ()
    """Steps of weather and operation."""

    foundation: FoundationSchedule = field(default_factory=FoundationSchedule)
    tide: Tide = field(default_factory=Tide)
    structure: str = ""
    """A description that differs from the updater's; empty: the same."""

    transient: float = 600.0
    """Time simulated from rest and dropped before the first sample [s]."""

    sampling_rate: float = 40.0
    """Sampling rate [Hz]."""

    block_duration: float = field(default=1.0, metadata=NO_KEY)
    """Block duration [s], as near to it as a whole number of samples is."""

    noise_share: float = 0.03
    """White noise as a share of each channel's rms by linear theory [-]."""

    instruments: Instruments = field(default_factory=Instruments)
    faults: tuple[Fault, ...] = ()
    units: tuple[UnitSettings, ...] = ()
    """Acquisition units; empty: one reads every channel."""

    scada_period: float = 0.0
    """Time between two SCADA samples [s]; 0: there are none."""

    quantisation_step: float = field(default=2.0**-12, metadata=NO_KEY)
    """Quantisation step [m/s²]: 16 bits over ±8 m/s²; 0: no converter."""

    start_ns: int = field(default=1_767_225_600 * NANOSECONDS, metadata=NO_KEY)
    """Sensor clock at the first sample: 2026-01-01."""

    session: str = field(default="", metadata=NO_KEY)
    """Name of the session; empty: "simulated-" and the seed."""

    tube_refinement: int = field(default=2, metadata=NO_KEY)
    """Elements in each of the description's tubes."""

    def __post_init__(self) -> None:
        for name in ("duration", "sampling_rate", "block_duration"):
            if not getattr(self, name) > 0:
                raise SimulationError(f"{name} is {getattr(self, name):g}; it must be positive")
        if self.duration > LONGEST_DURATION:
            raise SimulationError(
                f"duration is {self.duration:g} s; at most {LONGEST_DURATION:g} s, a hundred years"
            )
        if self.n_samples < 1:
            raise SimulationError(
                f"duration is {self.duration:g} s: no sample at {self.sampling_rate:g} Hz; at "
                f"least {1 / self.sampling_rate:g} s are needed"
            )
        for name in ("transient", "noise_share", "quantisation_step", "scada_period"):
            if not getattr(self, name) >= 0:
                raise SimulationError(f"{name} is {getattr(self, name):g}; it must be 0 or more")
        if self.seed < 0:
            raise SimulationError(f"seed is {self.seed}; it must be 0 or more")
        if self.tube_refinement < 1:
            raise SimulationError(
                f"tube_refinement is {self.tube_refinement}; it must be 1 or more"
            )

        names = [unit.name for unit in self.units]
        for name in names:
            if names.count(name) > 1:
                raise SimulationError(
                    f"units has {names.count(name)} called {name!r}; each has a name of its own"
                )

        turning = [step for step in self.stages if step.state not in (None, "parked")]
        if turning and self.wind is None:
            raise SimulationError(
                f"the stage at {turning[0].at:g} s is {turning[0].state!r}; a rotor that turns "
                "needs [simulation.wind]"
            )
        self._require_loads_of_stages()

    def _require_loads_of_stages(self) -> None:
        """Raise SimulationError for weather of a stage that no load would make."""
        needed = {
            "wind_speed": ("wind", self.wind),
            "significant_wave_height": ("sea", self.sea),
            "peak_period": ("sea", self.sea),
        }
        for step in self.stages:
            for name, (section, load) in needed.items():
                value = getattr(step, name)
                if value is not None and load is None:
                    raise SimulationError(
                        f"the stage at {step.at:g} s has {name} {value:g}, which needs "
                        f"[simulation.{section}]"
                    )

    @property
    def samples_per_block(self) -> int:
        """Number of samples in a block."""
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
        """Name of the session in every block."""
        return self.session or f"simulated-{self.seed}"
