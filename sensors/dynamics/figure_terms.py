"""Mass and stiffness as sums of fixed matrices times products of powers of the figures.

    K = Σ_j c_j(x) K_j,   M = Σ_j c_j(x) M_j + C W(level),   c_j = Π_i v_i^n_ij

v_i is 1 + departure for relative figures and the departure itself for the others. The structure's
matrices are such sums exactly: E and a wall's thickness multiply, a mass weighs on what is below
it. The matrices are found by differences of assembled descriptions, so that `assembly` stays the
only place that knows the structure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sensors.arrays import FloatArray
from sensors.structure.assembly import assemble
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import varied
from sensors.structure.foundation import spring_matrix
from sensors.structure.structural_model import StructuralModel

Powers = Mapping[str, int]

WALL_STEP = 0.1  # of the wall, for its quadratic [-]
LENGTH_STEP = 0.5  # of heights and of growth, likewise [m]


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One matrix and the powers of the figures that multiply it."""

    matrix: csr_array
    """(n_dofs, n_dofs), SI."""
    powers: Powers
    """Figure → exponent of its v; empty for what no figure changes."""


@dataclass(frozen=True, slots=True, eq=False)
class FigureTerms:
    """The whole structure, without springs."""

    mass: tuple[Term, ...]
    """Without the water outside."""
    stiffness: tuple[Term, ...]
    """Elastic and gravity."""
    levels: FloatArray
    """Of the water above the description's, rising, (n_levels,) [m]; (0,) on land."""
    water: tuple[csr_array, ...]
    """Mass of the water that moves along at those levels and C_a as described, (n_dofs, n_dofs)
    each."""
    inner_water: csr_array
    """Mass of the water inside a flooded structure, (n_dofs, n_dofs); zero where it is described as
    flooded already, or on land."""


def figure_terms(
    turbine: TurbineDescription, names: Sequence[str], levels: FloatArray
) -> FigureTerms:
    """Take a structure apart by its figures.

    Parameters
    ----------
    turbine : TurbineDescription
        The structure.
    names : sequence of str
        Of the figures that may be off; the others are as described.
    levels : ndarray, shape (n_levels,)
        Of the water above the description's, rising [m].
    """
    return _Parts(turbine, frozenset(names)).terms(levels)


class _Parts:
    """Differences of assembled descriptions."""

    def __init__(self, turbine: TurbineDescription, names: frozenset[str]) -> None:
        self._names = names
        self._turbine = turbine
        self._dry = turbine if turbine.water is None else _dried(turbine)
        self._model = self._matrices(self._dry)
        self._n = self._model[0].shape[0]
        # what does not concern the blades is found without them, whose mesh is the finest
        self._bare = replace(turbine, blades=None)
        self._tower = replace(self._dry, blades=None)
        self._tower_model = self._matrices(self._tower)

    def terms(self, levels: FloatArray) -> FigureTerms:
        mass, stiffness = self._tube_terms()
        for more_mass, more_stiffness in (self._nacelle_terms(), self._blade_terms()):
            mass, stiffness = mass + more_mass, stiffness + more_stiffness
        for name in ("point_masses", "transition_piece", "pile_mass"):
            if name in self._names:
                heavier = self._matrices(varied(self._tower, {name: 1.0}))
                mass.append(Term(heavier[0] - self._tower_model[0], {name: 1}))
                stiffness.append(Term(heavier[1] - self._tower_model[1], {name: 1}))
        mass, stiffness = self._whole(mass), self._whole(stiffness)
        mass.append(Term(self._model[0] - _sum(mass, self._described), {}))
        stiffness.append(Term(self._model[1] - _sum(stiffness, self._described), {}))
        return FigureTerms(
            mass=tuple(mass + self._whole(self._growth_terms())),
            stiffness=tuple(stiffness),
            levels=levels if self._turbine.water is not None else np.zeros(0),
            water=tuple(self._padded(matrix) for matrix in self._water_at(levels)),
            inner_water=self._padded(self._inner_water()),
        )

    def _whole(self, terms: Sequence[Term]) -> list[Term]:
        return [replace(term, matrix=self._padded(term.matrix)) for term in terms]

    def _padded(self, matrix: csr_array) -> csr_array:
        """Zero for the blades, whose degrees of freedom come after the tower's."""
        entries = matrix.tocoo()
        return csr_array((entries.data, entries.coords), shape=(self._n, self._n))

    @property
    def _described(self) -> Mapping[str, float]:
        """v of every figure as described."""
        return {name: 1.0 if name in RELATIVE else 0.0 for name in self._names}

    def _matrices(self, turbine: TurbineDescription) -> tuple[csr_array, csr_array]:
        """Mass and stiffness without springs."""
        model: StructuralModel = assemble(turbine)
        stiffness = model.stiffness.copy()
        springs = spring_matrix(model.theta, turbine.foundation.sign)
        for dofs in model.spring_dofs:
            stiffness[np.ix_(dofs, dofs)] -= springs
        return csr_array(model.mass), csr_array(stiffness)

    def _named(self, powers: Powers) -> Powers:
        return {name: n for name, n in powers.items() if name in self._names and n}

    def _tube_terms(self) -> tuple[list[Term], list[Term]]:
        """By powers 0, 1 and 2 of the wall's departure, times E and ρ: the area is quadratic in the
        wall's thickness and the cubic part of the second moment is 1e-5 of it."""
        steps = [-WALL_STEP, 0.0, WALL_STEP]
        if any((1 + WALL_STEP) * t.thickness > t.diameter / 2 for t in self._tower.tubes):
            steps = [-2 * WALL_STEP, -WALL_STEP, 0.0]  # a rod's wall has no room outwards
        elastic, heavy, weight = [], [], []
        for step in steps:
            thinner = varied(self._tower, {"wall_thickness": step})
            stiffer = varied(thinner, {"steel_modulus": 1.0})
            denser = varied(thinner, {"steel_density": 1.0})
            standing, floating = self._matrices(thinner), self._floated(thinner)
            elastic.append(self._floated(stiffer)[1] - floating[1])
            heavier = self._matrices(denser)
            heavy.append(heavier[0] - standing[0])
            weight.append(heavier[1] - standing[1])
        mass, stiffness = [], []
        for power in range(3 if "wall_thickness" in self._names else 1):
            wall = {"wall_thickness": power}
            density = self._named({"steel_density": 1, **wall})
            modulus = self._named({"steel_modulus": 1, **wall})
            stiffness.append(Term(_coefficient(elastic, steps, power), modulus))
            stiffness.append(Term(_coefficient(weight, steps, power), density))
            mass.append(Term(_coefficient(heavy, steps, power), density))
        return mass, stiffness

    def _nacelle_terms(self) -> tuple[list[Term], list[Term]]:
        mass: list[Term] = []
        stiffness: list[Term] = []
        for axis in ("roll", "pitch", "yaw"):
            name = f"nacelle_{axis}_inertia"
            if name in self._names:
                more = self._matrices(varied(self._tower, {name: 1.0}))
                mass.append(Term(more[0] - self._tower_model[0], {name: 1}))
        if not {"rna_mass", "rna_height"} & self._names:
            return mass, stiffness
        steps = [-LENGTH_STEP, 0.0, LENGTH_STEP]
        masses, weights = [], []
        for step in steps:
            raised = self._tower
            if "rna_height" in self._names:
                raised = varied(raised, {"rna_height": step})
            twice, once = self._matrices(varied(raised, {"rna_mass": 1.0})), self._matrices(raised)
            masses.append(twice[0] - once[0])
            weights.append(twice[1] - once[1])
        for power in range(3 if "rna_height" in self._names else 1):
            powers = self._named({"rna_mass": 1, "rna_height": power})
            mass.append(Term(_coefficient(masses, steps, power), powers))
            stiffness.append(Term(_coefficient(weights, steps, power), powers))
        return mass, stiffness

    def _blade_terms(self) -> tuple[list[Term], list[Term]]:
        mass: list[Term] = []
        stiffness: list[Term] = []
        if "blade_mass" in self._names:
            heavier = self._matrices(varied(self._dry, {"blade_mass": 1.0}))
            mass.append(Term(heavier[0] - self._model[0], {"blade_mass": 1}))
            stiffness.append(Term(heavier[1] - self._model[1], {"blade_mass": 1}))
        for name in ("flap_stiffness", "edge_stiffness"):
            if name in self._names:
                stiffer = self._floated(varied(self._dry, {name: 1.0}))
                floating = self._floated(self._dry)
                stiffness.append(Term(stiffer[1] - floating[1], {name: 1}))
        return mass, stiffness

    def _growth_terms(self) -> list[Term]:
        """Growth h thick beyond what is described: quadratic in h, its water by C_a."""
        if self._turbine.water is None:
            return []
        bare = replace(self._turbine.water, growth=0.0)

        def grown(water_weight: float, growth_weight: float, h: float) -> csr_array:
            water = replace(
                bare,
                growth=h,
                added_mass_coefficient=water_weight * bare.added_mass_coefficient,
                growth_density=growth_weight * bare.growth_density,
            )
            with_growth = self._matrices(replace(self._bare, water=water))[0]
            without = self._matrices(replace(self._bare, water=replace(water, growth=0.0)))[0]
            return with_growth - without

        described = self._turbine.water.growth
        steps = [0.0, LENGTH_STEP, 2 * LENGTH_STEP]
        found = []
        for powers, weights in (({"added_mass": 1}, (1.0, 0.0)), ({}, (0.0, 1.0))):
            matrices = [grown(*weights, described + step) for step in steps]
            for power in range(3 if "marine_growth" in self._names else 1):
                own = self._named({**powers, "marine_growth": power})
                found.append(Term(_coefficient(matrices, steps, power), own))
        return found

    def _water_at(self, levels: FloatArray) -> list[csr_array]:
        """Of the water outside, and inside where that is described, at each level."""
        water = self._turbine.water
        if water is None:
            return []
        around = replace(self._bare, water=replace(water, growth=0.0, inside=False))
        return [
            self._matrices(around.with_water_level(water.level + rise))[0] - self._tower_model[0]
            for rise in levels.tolist()
        ]

    def _inner_water(self) -> csr_array:
        """At the mean level, where it stands, whatever the sea outside does."""
        water = self._turbine.water
        if water is None:
            return csr_array(self._tower_model[0].shape)
        empty = replace(self._bare, water=replace(water, inside=False, level=0.0))
        full = replace(self._bare, water=replace(water, inside=True, level=0.0))
        return self._matrices(full)[0] - self._matrices(empty)[0]

    def _floated(self, turbine: TurbineDescription) -> tuple[csr_array, csr_array]:
        return self._matrices(replace(turbine, gravity=0.0))


RELATIVE = frozenset(
    {
        "steel_modulus",
        "steel_density",
        "rna_mass",
        "nacelle_roll_inertia",
        "nacelle_pitch_inertia",
        "nacelle_yaw_inertia",
        "blade_mass",
        "flap_stiffness",
        "edge_stiffness",
        "added_mass",
        "point_masses",
        "pile_mass",
    }
)  # whose v is 1 + departure


def _dried(turbine: TurbineDescription) -> TurbineDescription:
    return replace(turbine, water=None)


def _coefficient(values: Sequence[csr_array], steps: Sequence[float], power: int) -> csr_array:
    """Coefficient of step^power of the parabola through three values."""
    weights = np.linalg.inv(np.vander(np.array(steps), 3, increasing=True))[power].tolist()
    return weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2]


def _sum(terms: Sequence[Term], at: Mapping[str, float]) -> csr_array:
    total = csr_array(terms[0].matrix.shape)
    for term in terms:
        weight = float(np.prod([at[name] ** n for name, n in term.powers.items()]))
        total = total + weight * term.matrix
    return total


class Monomials:
    """c_j(x) = Π v_i^n_ij of a list of terms, and its derivatives by the departures."""

    def __init__(self, terms: Sequence[Term], names: Sequence[str]) -> None:
        self._offset = np.array([1.0 if name in RELATIVE else 0.0 for name in names])
        self._powers = np.array(
            [[term.powers.get(name, 0) for name in names] for term in terms], dtype=float
        ).reshape(len(terms), len(names))
        self._figure, self._term = np.nonzero(self._powers.T)  # of each derivative that is not 0
        self._exponents = self._powers[self._term, self._figure]
        self._derived = self._powers[self._term].copy()
        self._derived[np.arange(len(self._term)), self._figure] -= 1

    def values(self, departures: FloatArray) -> FloatArray:
        """(n, n_terms) for departures, (n, q)"""
        v = departures + self._offset
        return np.prod(v[:, None, :] ** self._powers, axis=2)

    def slopes(self, departures: FloatArray) -> FloatArray:
        """(q, n_terms) for departures, (q,)"""
        v = departures + self._offset
        found = np.zeros(self._powers.shape[::-1])
        found[self._figure, self._term] = self._exponents * np.prod(v**self._derived, axis=1)
        return found
