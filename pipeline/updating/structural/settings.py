"""Section [structure] of a scenario: which figures of the structure are uncertain, and by how much.

    [structure.uncertain]
    steel_modulus = 0.02     # standard deviation of the prior instead of the default
    transition_piece = "exact"

    [structure]
    uncertain = "exact"      # all of it: the description is the truth

Without the section every figure has its default uncertainty: a structure is never known exactly,
and to take it so is a choice that is written down.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.prior import StructuralPrior, UncertainFigure
from pipeline.updating.structural.sensors.figures import GAIN_STD, HEADING_STD, HEIGHT_STD
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import (
    FIGURES,
    KNOWN_LEVEL_STD,
    LEVEL,
    TIDE_STD,
    UNKNOWN_LEVEL_STD,
    figures_of,
)

EXACT_WORD = "exact"
OTHERS: Mapping[str, float] = {
    LEVEL: KNOWN_LEVEL_STD,
    "unknown_water_level": UNKNOWN_LEVEL_STD,
    "sensor_gain": GAIN_STD,
    "sensor_heading": HEADING_STD,
    "sensor_height": HEIGHT_STD,
}  # keys that are no figures of the description, with their defaults
CHOICES = (
    "flooding",
    "blade_model",
    "tube_shear",
)  # discrete alternatives, which can only be exact
KNOWN = (*(figure.name for figure in FIGURES), *OTHERS, *CHOICES)
LARGEST_SHARE = 0.5  # standard deviation of a relative figure [-]


@dataclass(frozen=True, slots=True)
class StructureSettings:
    """How well the structure is known."""

    exact: bool = True
    """Every figure is as described."""
    stated: bool = True
    """False: a recording made before there was a choice; its scenario meant an exact structure."""
    stds: tuple[tuple[str, float], ...] = ()
    """Key → standard deviation where the scenario sets it, 0 for "exact"; others have defaults."""

    def std(self, name: str, default: float) -> float:
        """Standard deviation of the prior of a figure, in its unit."""
        return dict(self.stds).get(name, default)

    def is_exact(self, name: str) -> bool:
        """Whether a discrete alternative is ruled out."""
        return dict(self.stds).get(name, 1.0) == 0.0

    def prior(self, turbine: TurbineDescription) -> StructuralPrior:
        """The prior of the figures that a structure has."""
        figures = (UncertainFigure(f.name, self.std(f.name, f.std)) for f in figures_of(turbine))
        uncertain = tuple(figure for figure in figures if figure.std > 0)
        if turbine.water is None:
            return StructuralPrior(uncertain, 0.0, 0.0, 0.0)
        return StructuralPrior(
            figures=uncertain,
            known_level_std=self.std(LEVEL, KNOWN_LEVEL_STD),
            unknown_level_std=self.std("unknown_water_level", UNKNOWN_LEVEL_STD),
            tide_std=self.std("unknown_water_level", TIDE_STD),
        )


UNCERTAIN = StructureSettings(exact=False)  # what a scenario that does not mention it means


def structure_settings(table: Any, where: str) -> StructureSettings:
    """Read [structure].

    Parameters
    ----------
    table : object
        The section as the file has it.
    where : str
        The file, for errors.

    Raises
    ------
    UpdatingError
        In one line: an unknown key, or a value that is no standard deviation.
    """
    if not isinstance(table, Mapping) or set(table) - {"uncertain"}:
        keys = list(table) if isinstance(table, Mapping) else table
        raise UpdatingError(f"{where} [structure]: {keys!r}; it takes one key, uncertain")
    uncertain = table.get("uncertain", {})
    if uncertain == EXACT_WORD:
        return StructureSettings(exact=True)
    if not isinstance(uncertain, Mapping):
        raise UpdatingError(
            f'{where} [structure]: uncertain is {uncertain!r}; it is "exact" or a table of '
            "standard deviations"
        )
    section = f"{where} [structure.uncertain]"
    stds = tuple((key, _std(key, value, section)) for key, value in uncertain.items())
    return StructureSettings(exact=False, stds=stds)


def _std(key: str, value: Any, where: str) -> float:
    if key == "scour_depth":
        raise UpdatingError(
            f"{where}: scour_depth: one soil's curve reads 3 m of scour in clay as 1 to 1.5 m, so "
            "no soil, no depth: scour shows as a change of the springs"
        )
    if key not in KNOWN:
        close = difflib.get_close_matches(key, KNOWN, n=1)
        advice = f"did you mean {close[0]!r}?" if close else f"it takes {', '.join(KNOWN)}"
        raise UpdatingError(f"{where}: unknown key {key!r}; {advice}")
    if value == EXACT_WORD:
        return 0.0
    if key in CHOICES:
        raise UpdatingError(f'{where}: {key} is {value!r}; it can only be "exact"')
    if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
        raise UpdatingError(
            f'{where}: {key} is {value!r}; a standard deviation from 0 or "exact" is needed'
        )
    relative = any(figure.name == key and figure.unit == "-" for figure in FIGURES)
    if relative and value > LARGEST_SHARE:
        raise UpdatingError(
            f"{where}: {key} is {value:g}; the standard deviation of a share is at most "
            f"{LARGEST_SHARE:g}"
        )
    return float(value)
