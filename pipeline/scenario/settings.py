"""What a scenario may set: one section of its file, one type."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pipeline.nodes.operating_state import OperationSettings
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.block_admission import LimitSettings
from pipeline.recording.settings import RecordingSettings
from pipeline.updating.population import StiffnessPopulation, load_population, population_from_json
from pipeline.updating.settings import UpdatingSettings
from sensors.acquisition.key_parts import named_key_part_error
from sensors.acquisition.layout import Coupling, SensorLayout, biaxial_layout
from sensors.errors import InputError
from sensors.settings import NEVER_A_KEY
from sensors.simulation.tower import SimulationSettings
from sensors.structure.description import TurbineDescription, load_turbine, parse_turbine

DEFAULT_SCENARIO = "parked"
NO_STRUCTURE = "none"  # as `[turbine] description`: modes are tracked, nothing is updated


class ScenarioError(InputError):
    """A scenario that cannot be run; the message names file, section and key."""


def _require_key_part(key: str, name: str) -> None:
    if wrong := named_key_part_error(name):
        raise ScenarioError(f"{key} is {name!r}: {wrong}")


@dataclass(frozen=True, slots=True)
class TurbineSettings:
    """Which structure is watched, and under what name its messages travel."""

    id: str = "iea15mw"
    """Name of the turbine in every key and message."""

    description: str = "iea15mw_monopile"
    """Structure: a shipped one, a path to one's own, or "none"."""

    springs_sign: Literal["published", "embedded-pile"] | None = None
    """Sign convention of k12; None: as the description has it."""

    def __post_init__(self) -> None:
        _require_key_part("id", self.id)


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """The bi-axial accelerometers of the acquisition unit."""

    unit: str = "tower"
    """Name of the acquisition unit, part of its keys."""
    layout_id: str = "tower-1"
    """Name of the layout, in every message."""
    elevations: tuple[float, ...] = (41.0, 80.0, 106.0, 145.0)
    """Elevations above mean water level [m]."""

    coupling: Coupling = "dc"
    """"dc" or "ac"; a DC-coupled sensor feels the tilt of the tower."""
    corner_frequency: float = 0.0
    """Corner frequency of AC-coupled ones [Hz]."""

    def __post_init__(self) -> None:
        _require_key_part("unit", self.unit)
        if not self.elevations:
            raise ScenarioError("elevations is []; a unit has at least one sensor")


@dataclass(frozen=True, slots=True)
class FarmMember:
    """Values of one turbine that differ from the scenario's; "" and () keep the scenario's."""

    number: int | None = None
    """Number from 1; None: its place in the list."""

    id: str = ""
    """Name of the turbine."""
    description: str = ""
    """Its structure, as in [turbine]."""
    springs_sign: Literal["published", "embedded-pile"] | None = None
    """Sign convention of k12, as in [turbine]."""
    unit: str = ""
    """Name of its acquisition unit."""
    layout_id: str = ""
    """Name of its layout."""
    elevations: tuple[float, ...] = ()
    """Elevations above mean water level [m]."""

    stiffness: tuple[float, float, float] = (
        1.0,
        1.0,
        1.0,
    )
    """Factors of its true springs k11, k22, k12, times the drawn ones [-]."""

    def __post_init__(self) -> None:
        for key in ("id", "unit"):
            if name := getattr(self, key):
                _require_key_part(key, name)
        if not min(self.stiffness) > 0:
            raise ScenarioError(f"stiffness is {list(self.stiffness)}; factors are positive")


@dataclass(frozen=True, slots=True)
class FarmSettings:
    """Several turbines alike but for their foundations, and for what `members` sets for some."""

    turbines: int = 1
    """Number of turbines; `members` may make it larger."""

    spread: float = 0.0
    """Spread of the true springs about the scenario's, uniform, relative [-]."""

    log_std: float = 0.0
    """Standard deviation of the logarithms of the true springs, Gaussian, independent [-]."""

    members: tuple[FarmMember, ...] = ()

    def __post_init__(self) -> None:
        if not self.turbines >= 1:
            raise ScenarioError(f"turbines is {self.turbines}; a farm has at least 1")
        if not 0.0 <= self.spread < 0.5:
            raise ScenarioError(f"spread is {self.spread:g}; it is 0 to 0.5")
        if not 0.0 <= self.log_std < 0.5:
            raise ScenarioError(f"log_std is {self.log_std:g}; it is 0 to 0.5")
        numbers = [number for number, _ in self._numbered]
        if min(numbers, default=1) < 1 or len(set(numbers)) < len(numbers):
            raise ScenarioError(f"members have the numbers {numbers}; each once, from 1")

    @property
    def _numbered(self) -> tuple[tuple[int, FarmMember], ...]:
        placed = enumerate(self.members, start=1)
        return tuple((place if m.number is None else m.number, m) for place, m in placed)

    @property
    def size(self) -> int:
        """Turbines, those of `members` counted."""
        return max(self.turbines, *(number for number, _ in self._numbered), 1)

    def member(self, number: int) -> FarmMember:
        """Return the values of the turbine of that number, from 1."""
        return dict(self._numbered).get(number, FarmMember())


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that a session is made of. One section of the file per field."""

    name: str
    """Short name; the file's by default."""
    title: str = ""
    """One line for people."""
    description: str = ""
    """What the scenario is for, in sentences."""
    seed: int = 1
    """Seed of every random choice: loads, noise, sampler."""
    turbine: TurbineSettings = field(default_factory=TurbineSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    oma: OmaSettings = field(default_factory=OmaSettings)
    updating: UpdatingSettings = field(default_factory=UpdatingSettings)
    operation: OperationSettings = field(default_factory=OperationSettings)
    farm: FarmSettings = field(default_factory=FarmSettings)
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    text: str = field(default="", metadata=NEVER_A_KEY)
    """The file as it was read."""

    origin: str = field(default=DEFAULT_SCENARIO, metadata=NEVER_A_KEY)
    """Shipped name or path, as the person gave it."""

    files: tuple[tuple[str, str], ...] = field(default=(), metadata=NEVER_A_KEY)
    """(path, text) of each file that the scenario names, from a recording."""

    @property
    def layout(self) -> SensorLayout:
        """The layout of the simulated or live unit; a recording brings its own."""
        return biaxial_layout(
            self.sensors.layout_id,
            turbine=self.turbine.id,
            unit=self.sensors.unit,
            elevations=self.sensors.elevations,
            coupling=self.sensors.coupling,
            corner_frequency=self.sensors.corner_frequency,
        )

    @property
    def population(self) -> StiffnessPopulation | None:
        """Population of the farm for this turbine's springs; None without `[updating] population`.

        Raises
        ------
        UpdatingError
            For a file that cannot be read or is none.
        """
        file = self.updating.population
        if not file:
            return None
        stored = dict(self.files).get(file)
        return load_population(Path(file)) if stored is None else population_from_json(stored, file)

    @property
    def has_structure(self) -> bool:
        """Whether there is a structural model; without one modes are tracked and no more."""
        return self.turbine.description != NO_STRUCTURE

    @property
    def structure(self) -> TurbineDescription:
        """The turbine's description with the scenario's sign convention of k12.

        Raises
        ------
        ScenarioError
            If there is none.
        """
        if not self.has_structure:
            raise ScenarioError(
                f"scenario {self.name} has no structural model ([turbine] description = "
                f'"{NO_STRUCTURE}"), which this needs: a shipped one or a file by '
                "`pilewatch describe --template`"
            )
        name = self.turbine.description
        stored = dict(self.files).get(name)
        described = load_turbine(name) if stored is None else parse_turbine(stored, source=name)
        if self.turbine.springs_sign is None:
            return described
        return described.with_sign(self.turbine.springs_sign)
