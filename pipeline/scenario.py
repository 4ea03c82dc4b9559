"""One TOML file is the whole experiment: turbine, sensors, simulation, identification, updating.

Shipped scenarios live in `pipeline/scenarios`; a path to a file of one's own works wherever a
name does. The text of the scenario is stored in every recording, so that any recording can be
run again.
"""

import json
import logging
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.nodes.limits import LimitSettings
from pipeline.nodes.operating_state import OperationSettings
from pipeline.oma.settings import OmaSettings
from pipeline.recording.settings import RecordingSettings
from pipeline.updating.population import (
    StiffnessPopulation,
    load_population,
    population_from_json,
)
from pipeline.updating.prior import UpdatingError
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.settings import (
    UNCERTAIN,
    StructureSettings,
    structure_settings,
)
from sensors.acquisition.layout import Coupling, SensorLayout, biaxial_layout
from sensors.errors import InputError
from sensors.settings import NEVER_A_KEY, settings_from_table, toml_string, without_constants
from sensors.simulation.tower import SimulationSettings
from sensors.structure.description import (
    SHIPPED,
    TurbineDescription,
    load_turbine,
    parse_turbine,
)
from sensors.structure.foundation import positive_definite

logger = logging.getLogger(__name__)

DEFAULT_SCENARIO = "parked"
MODES_ONLY = "modes-only"  # the shipped scenario of a structure of which no model is given
EXACT, EXACT_AS_RECORDED = "exact", "exact as recorded"  # structure, as recordings store it; the
# latter where the scenario is from before there was a choice
NO_STRUCTURE = "none"  # as `[turbine] description`: modes are tracked, nothing is updated


class ScenarioError(InputError):
    """A scenario that cannot be run; the message names file, section and key."""


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
        if not self.id or any(letter in self.id for letter in "/*$#? "):
            raise ScenarioError(
                f"id is {self.id!r}; a name without spaces and / * $ # ? is needed "
                "(it becomes part of a Zenoh key)"
            )


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
    """Of every random choice: loads, noise, sampler."""
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


def shipped_scenarios() -> tuple[str, ...]:
    """Return names of the scenarios inside the package."""
    folder = resources.files("pipeline") / "scenarios"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def load_scenario(name_or_path: str) -> Scenario:
    """Return a shipped scenario by name, or one's own by path.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        No such scenario, not TOML, an unknown key or a wrong value (the message names file,
        section and key).
    """
    if name_or_path in shipped_scenarios():
        shipped = resources.files("pipeline") / "scenarios" / f"{name_or_path}.toml"
        text = shipped.read_text(encoding="utf-8")
        return replace(scenario_from_text(text, f"{name_or_path}.toml"), origin=name_or_path)
    path = Path(name_or_path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        return replace(scenario_from_text(text, name_or_path), origin=name_or_path)
    except FileNotFoundError:
        shipped_names = ", ".join(shipped_scenarios())
        raise ScenarioError(
            f"scenario {name_or_path!r} is neither a file nor one of the shipped ones "
            f"({shipped_names})"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"scenario {name_or_path!r} cannot be read: {error}") from error


def scenario_from_text(text: str, origin: str) -> Scenario:
    """Return the scenario that a TOML text describes; `origin` names it in errors."""
    try:
        table: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from error
    return _scenario_from_table(table, text, origin)


def _scenario_from_table(table: dict[str, Any], text: str, origin: str) -> Scenario:
    _check_updating(table.get("updating"), origin)
    structure = table.pop("structure", None)
    table.setdefault("name", Path(origin).stem)
    scenario = replace(settings_from_table(Scenario, table, origin, ScenarioError), text=text)
    return with_structure(scenario, _structure(structure, origin))


def _structure(table: Any, origin: str) -> StructureSettings:
    """Section [structure]; without it every figure is uncertain."""
    if table is None:
        return UNCERTAIN
    try:
        return structure_settings(table, f"{origin} [structure]")
    except UpdatingError as error:
        raise ScenarioError(str(error)) from error


def _check_updating(table: Any, origin: str) -> None:
    if isinstance(table, Mapping) and "uncertain" in table:
        raise ScenarioError(
            f"{origin} [updating.uncertain]: figures of the structure now stand in "
            "[structure.uncertain], each with a default; steel_modulus, rna_mass and added_mass "
            "keep their names"
        )
    if isinstance(table, Mapping) and "structure" in table:
        raise ScenarioError(f"{origin} [updating]: unknown key 'structure'; it is a section")


def with_structure(scenario: Scenario, structure: StructureSettings) -> Scenario:
    """Return the scenario with other figures of the structure uncertain."""
    return replace(scenario, updating=replace(scenario.updating, structure=structure))


def modes_only(turbine: str) -> Scenario:
    """Return the scenario of a turbine without a structural model: modes are tracked, no more."""
    scenario = load_scenario(MODES_ONLY)
    before, after = toml_string(scenario.turbine.id), toml_string(turbine)
    text = scenario.text.replace(f"id = {before}", f"id = {after}")
    return replace(scenario_from_text(text, f"{MODES_ONLY}.toml"), origin=MODES_ONLY)


def with_overrides(
    scenario: Scenario, *, duration: float | None = None, seed: int | None = None
) -> Scenario:
    """Return the scenario with another duration of its simulation [s] or another seed."""
    simulation = scenario.simulation
    if duration is not None:
        simulation = replace(simulation, duration=duration)
    return replace(scenario, simulation=simulation, seed=scenario.seed if seed is None else seed)


def farm_members(scenario: Scenario) -> tuple[Scenario, ...]:
    """Return the scenario of each turbine.

    An id, a seed and, about the scenario's, a truth of its own.

    A farm of one is the scenario itself. Truths that are not positive definite are drawn again.
    """
    farm = scenario.farm
    if farm.size == 1 and not farm.members:
        return (scenario,)
    truths = np.random.default_rng([scenario.seed, farm.size])
    numbers = range(1, farm.size + 1)
    members = tuple(_member(scenario, number, truths) for number in numbers)
    ids = [member.turbine.id for member in members]
    for name in ids:
        if ids.count(name) > 1:
            raise ScenarioError(f"[farm] has {ids.count(name)} turbines called {name!r}")
    return members


def _member(scenario: Scenario, number: int, truths: np.random.Generator) -> Scenario:
    own = scenario.farm.member(number)
    turbine, sensors = scenario.turbine, scenario.sensors
    member = replace(
        scenario,
        seed=1000 * scenario.seed + number,
        turbine=replace(
            turbine,
            id=own.id or f"{turbine.id}-{number}",
            description=own.description or turbine.description,
            springs_sign=own.springs_sign or turbine.springs_sign,
        ),
        sensors=replace(
            sensors,
            unit=own.unit or sensors.unit,
            layout_id=own.layout_id or f"{sensors.layout_id}-{number}",
            elevations=own.elevations or sensors.elevations,
        ),
        farm=FarmSettings(),
    )
    if not scenario.has_structure:
        return member
    ratios = _true_ratios(member, scenario.farm, own, truths)
    return replace(member, simulation=replace(scenario.simulation, stiffness_ratios=ratios))


def _true_ratios(
    member: Scenario, farm: FarmSettings, own: FarmMember, truths: np.random.Generator
) -> tuple[float, float, float]:
    """k / nominal, drawn until positive definite."""
    nominal, centre = member.structure.nominal, np.array(member.simulation.stiffness_ratios)
    for _ in range(1000):
        even = 1.0 + truths.uniform(-farm.spread, farm.spread, 3)
        scatter = np.exp(farm.log_std * truths.standard_normal(3)) if farm.log_std else 1.0
        ratios = centre * own.stiffness * even * scatter
        if positive_definite(ratios * nominal):
            k11, k22, k12 = ratios.tolist()
            return k11, k22, k12
    raise ScenarioError(
        f"[farm] turbine {member.turbine.id}: of 1000 drawn foundations about "
        f"{(centre * own.stiffness).tolist()} times nominal none is positive definite"
    )


def with_sampler(scenario: Scenario, method: str) -> Scenario:
    """Return the scenario with another sampler of the posterior.

    Returns
    -------
    Scenario

    Raises
    ------
    UpdatingError
    """
    sampling = replace(scenario.updating.sampling, method=method)  # type: ignore[arg-type]
    return replace(scenario, updating=replace(scenario.updating, sampling=sampling))


def scenario_metadata(scenario: Scenario) -> dict[str, str]:
    """Return what a recording stores of its scenario: enough to make the same scenario again.

    Parameters
    ----------
    scenario : Scenario
        The scenario of the run.

    Returns
    -------
    dict of str to str
        Name, seed, duration, whether the structure is exact, the TOML text, and, where the
        scenario names files of one's own (descriptions, a population), their texts under `files`
        as JSON.
    """
    metadata = {
        "structure": _structure_word(scenario.updating.structure),
        "name": scenario.name,
        "seed": str(scenario.seed),
        "duration": repr(scenario.simulation.duration),
        "toml": scenario.text,
    }
    files = _named_files(scenario)
    return metadata | ({"files": json.dumps(files, ensure_ascii=False, indent=1)} if files else {})


def _structure_word(structure: StructureSettings) -> str:
    if not structure.exact:
        return "uncertain"
    return EXACT if structure.stated else EXACT_AS_RECORDED


def _named_files(scenario: Scenario) -> dict[str, str]:
    """Return the texts of the files that a scenario names, those it brings along first."""
    names = [
        scenario.turbine.description,
        *(member.description for member in scenario.farm.members),
        scenario.simulation.structure,
        scenario.updating.population,
    ]
    found = dict(scenario.files)
    for name in names:
        if name and name not in (*SHIPPED, NO_STRUCTURE) and name not in found:
            with suppress(OSError, UnicodeDecodeError):  # who needs the file reports it
                found[name] = Path(name).read_text(encoding="utf-8-sig")
    return found


REMOVED_SECTIONS = ("flow",)  # of earlier versions; recordings may have them


def _of_this_version(table: Mapping[str, Any], origin: str) -> dict[str, Any]:
    """Return a stored scenario's table without keys that this version no longer has."""
    known = {key: value for key, value in table.items() if key not in REMOVED_SECTIONS}
    kept, dropped = without_constants(Scenario, known)
    if dropped:
        _note_dropped(origin, dropped)
    return kept


@cache
def _note_dropped(origin: str, keys: tuple[str, ...]) -> None:
    """Log once that keys of a recording's scenario have no effect any more."""
    logger.warning("%s: ignored, now constants: %s", origin, ", ".join(keys))


def scenario_from_metadata(metadata: Mapping[str, str], origin: str) -> Scenario:
    """Return the scenario that a recording was made under, with the files that it names.

    Parameters
    ----------
    metadata : mapping of str to str
        What `scenario_metadata` returned.
    origin : str
        Where it is stored, for errors.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        If the stored text describes no scenario of this version.
    """
    text = metadata["toml"]
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from error
    stored = _scenario_from_table(_of_this_version(table, origin), text, origin)
    # made before there was a choice: its scenario meant the described structure
    earlier = EXACT_AS_RECORDED if "structure" not in table else ""
    structure = metadata.get("structure", earlier)
    if structure in (EXACT, EXACT_AS_RECORDED) and not stored.updating.structure.exact:
        exact = StructureSettings(exact=True, stated=structure == EXACT)
        stored = with_structure(stored, exact)
    files = json.loads(metadata.get("files", "{}"))
    return with_overrides(
        replace(stored, name=metadata["name"], files=tuple(files.items())),
        duration=float(metadata["duration"]),
        seed=int(metadata["seed"]),
    )
