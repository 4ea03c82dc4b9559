"""The matrices of a decoupled group of a structure: with all its coordinates, and in a basis.

Groups never exchange energy (`full_model_modes.decoupled_groups`), so each has a basis of its own.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sensors.arrays import FloatArray
from sensors.dynamics.figure_terms import FigureTerms
from sensors.dynamics.snapshot_basis import SparseStack
from sensors.structure.foundation import spring_matrix
from sensors.structure.placed_readings import MovableReadings
from sensors.structure.structural_model import StructuralModel

LEVEL_SPACING = 0.5  # between the tabulated levels of the water; cubics between them [m]


@dataclass(frozen=True, slots=True, eq=False)
class FigureGroup:
    """One decoupled group in its basis, m vectors of all degrees of freedom."""

    basis: FloatArray
    """(n_dofs, m)"""
    mass: FloatArray
    """(n_mass_terms, m, m)"""
    stiffness: FloatArray
    """(n_stiffness_terms, m, m)"""
    water: FloatArray
    """(n_levels, m, m)"""
    water_slopes: FloatArray
    """(n_levels, m, m) by the level [1/m]"""
    inner_water: FloatArray
    """(m, m)"""
    springs: FloatArray
    """(3, m, m) of unit k11, k22 and k12"""
    readings: MovableReadings
    """Of the m coordinates."""


@dataclass(frozen=True, slots=True, eq=False)
class SparseGroup:
    """One decoupled group with all its coordinates."""

    coordinates: csr_array
    """(n_dofs, n)"""
    mass: SparseStack
    stiffness: SparseStack
    water: SparseStack
    inner_water: SparseStack
    """One matrix."""
    springs: SparseStack
    """Of unit k11, k22 and k12."""

    @classmethod
    def of(
        cls, model: StructuralModel, terms: FigureTerms, coordinates: FloatArray
    ) -> "SparseGroup":
        """The group of a structure with these coordinates, (n_dofs, n)."""
        Y = csr_array(coordinates)

        def turned(matrices: Iterable[csr_array]) -> SparseStack:
            return SparseStack([Y.T @ matrix @ Y for matrix in matrices])

        return cls(
            coordinates=Y,
            mass=turned(term.matrix for term in terms.mass),
            stiffness=turned(term.matrix for term in terms.stiffness),
            water=turned(terms.water),
            inner_water=turned([terms.inner_water]),
            springs=turned(_unit_springs(model)),
        )

    def reduced(self, basis: FloatArray, readings: MovableReadings) -> FigureGroup:
        """The group in a basis, (n, m), as channels read it."""
        vectors = self.coordinates @ basis
        water = self.water.congruent(basis)
        slopes = water
        if len(water):
            slopes = np.gradient(water, LEVEL_SPACING, axis=0, edge_order=2)
        return FigureGroup(
            basis=vectors,
            mass=self.mass.congruent(basis),
            stiffness=self.stiffness.congruent(basis),
            water=water,
            water_slopes=slopes,
            inner_water=self.inner_water.congruent(basis)[0],
            springs=self.springs.congruent(basis),
            readings=readings.in_basis(vectors),
        )


def _unit_springs(model: StructuralModel) -> list[csr_array]:
    """Stiffness of unit k11, k22 and k12 in both planes, (n_dofs, n_dofs) each."""
    found = []
    for springs in spring_matrix(np.eye(3), model.description.foundation.sign):
        whole = np.zeros((model.n_dofs, model.n_dofs))
        for dofs in model.spring_dofs:
            whole[np.ix_(dofs, dofs)] += springs
        found.append(csr_array(whole))
    return found
