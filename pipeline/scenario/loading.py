"""Scenarios from names, files, texts and recordings; variants of them; what a recording stores."""

import json
import logging
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from pipeline.scenario.settings import NO_STRUCTURE, Scenario, ScenarioError
from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.settings import UNCERTAIN, StructureSettings, structure_settings
from sensors.settings import settings_from_table, toml_string, toml_table, without_constants
from sensors.structure.description import SHIPPED

logger = logging.getLogger(__name__)

MODES_ONLY = "modes-only"  # the shipped scenario of a structure of which no model is given
EXACT, EXACT_AS_RECORDED = "exact", "exact as recorded"  # structure, as recordings store it; the
# latter where the scenario is from before there was a choice
REMOVED_SECTIONS = ("flow",)  # of earlier versions; recordings may have them


def shipped_scenarios() -> tuple[str, ...]:
    """Return names of the scenarios inside the package."""
    folder = resources.files("pipeline") / "scenarios"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def load_scenario(name_or_path: str) -> Scenario:
    """Return a shipped scenario by name, or one's own by path.

    A file that one's own names is the one beside it, and only where there is none the one in the
    working folder.

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
        scenario = replace(scenario_from_text(text, name_or_path), origin=name_or_path)
        return _with_files_beside(scenario, path.parent)
    except FileNotFoundError:
        shipped_names = ", ".join(shipped_scenarios())
        raise ScenarioError(
            f"scenario {name_or_path!r} is neither a file nor one of the shipped ones "
            f"({shipped_names})"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"scenario {name_or_path!r} cannot be read: {reason}") from error


def scenario_from_text(text: str, origin: str) -> Scenario:
    """Return the scenario that a TOML text describes; `origin` names it in errors."""
    return scenario_from_table(toml_table(text, origin, ScenarioError), text, origin)


def scenario_from_table(table: dict[str, Any], text: str, origin: str) -> Scenario:
    """Return the scenario of a parsed TOML text."""
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
        return structure_settings(table, origin)
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


def require_stated_structure(scenario: Scenario) -> Scenario:
    """Return the scenario of a turbine that is measured. The reference turbine, which simulations
    have by default, is never assumed of one.

    Raises
    ------
    ScenarioError
        If its text leaves open whose structure is measured.
    """
    turbine = tomllib.loads(scenario.text).get("turbine", {}) if scenario.text else None
    members = scenario.farm.members
    by_member = bool(members) and all(member.description for member in members)
    if turbine is not None and "description" not in turbine and not by_member:
        raise ScenarioError(
            f"{scenario.origin} does not say which structure is measured, and none is assumed: "
            f'[turbine] description = "FILE.toml" or "{SHIPPED[0]}"; "{NO_STRUCTURE}" to track '
            "modes alone"
        )
    return scenario


def with_overrides(
    scenario: Scenario, *, duration: float | None = None, seed: int | None = None
) -> Scenario:
    """Return the scenario with another duration of its simulation [s] or another seed."""
    simulation = scenario.simulation
    if duration is not None:
        simulation = replace(simulation, duration=duration)
    return replace(scenario, simulation=simulation, seed=scenario.seed if seed is None else seed)


def with_sampler(scenario: Scenario, method: str) -> Scenario:
    """Return the scenario with another sampler of the posterior.

    Parameters
    ----------
    scenario : Scenario
        The whole experiment.
    method : str
        Name of the sampler.

    Raises
    ------
    UpdatingError
        If there is no such sampler.
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
    return _texts_in(Path(), scenario) | dict(scenario.files)


def _with_files_beside(scenario: Scenario, folder: Path) -> Scenario:
    """Return the scenario with the texts of the files that it names and that are in its folder."""
    beside = _texts_in(folder, scenario)
    for name in beside:
        other = Path(name)
        if other.is_file() and not other.samefile(folder / name):
            logger.warning(
                "%s: %s is %s, beside the scenario, and not %s", scenario.origin, name,
                folder / name, other.resolve(),
            )  # fmt: skip
    structure = scenario.simulation.structure
    if structure in beside:
        simulation = replace(scenario.simulation, structure=str(folder / structure))
        scenario = replace(scenario, simulation=simulation)
    return replace(scenario, files=tuple(beside.items()))


def _texts_in(folder: Path, scenario: Scenario) -> dict[str, str]:
    """Return the texts of the files that a scenario names and that can be read from a folder."""
    names = [
        scenario.turbine.description,
        *(member.description for member in scenario.farm.members),
        scenario.simulation.structure,
        scenario.updating.population,
    ]
    found = {}
    for name in names:
        if name and name not in (*SHIPPED, NO_STRUCTURE):
            with suppress(OSError, UnicodeDecodeError):  # who needs the file reports it
                found[name] = (folder / name).read_text(encoding="utf-8-sig")
    return found


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

    Raises
    ------
    ScenarioError
        If the stored text describes no scenario of this version.
    """
    text = metadata["toml"]
    table = toml_table(text, origin, ScenarioError)
    stored = scenario_from_table(_of_this_version(table, origin), text, origin)
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
