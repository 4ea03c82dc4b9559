"""A pile below the mudline: a beam in a bed of springs, with its mass and what soil moves along.

An updater's springs stand for it: `Pile.springs` is what the mudline feels of it at rest. In motion
its own mass acts too, exactly here, which no springs have.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, eigh, solve

from sensors.arrays import FloatArray
from tests.outside.beams import integration_points, quintic, weighted
from tests.outside.model import HIGHEST_FREQUENCY, PLANES, Modes, Structure

ELEMENTS = 8
MUDLINE = slice(-2, None)
"""(v, v') of the pile's upper end."""


@dataclass(frozen=True)
class Pile:
    """Uniform, in a bed whose stiffness is bed (depth / length)^power."""

    length: float
    """[m]"""
    rigidity: float
    """E I [N·m²]"""
    moving_mass: float
    """Of the pile, and of the soil that moves with it [kg/m]."""
    bed: float
    """Lateral stiffness by length at the toe [N/m²]."""
    power: float
    """Of the depth, with which the bed's stiffness grows [-]."""

    @cached_property
    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """Stiffness and mass of (v, v') of all nodes in one plane, from the toe up, (n, n) each."""
        edges = np.linspace(-self.length, 0.0, ELEMENTS + 1)
        size = 2 * (2 * ELEMENTS + 1)
        stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
        for index in range(ELEMENTS):
            bottom, top = edges[index : index + 2]
            z, weights = integration_points(bottom, top)
            shapes, bends = quintic(z, bottom, top), quintic(z, bottom, top, derivative=2)
            soil = self.bed * (-z / self.length) ** self.power
            own = slice(4 * index, 4 * index + 6)
            stiffness[own, own] += weighted(bends, weights * self.rigidity)
            stiffness[own, own] += weighted(shapes, weights * soil)
            mass[own, own] += weighted(shapes, weights * self.moving_mass)
        return stiffness, mass

    @cached_property
    def springs(self) -> FloatArray:
        """k11 [N/m], k22 [N·m/rad], k12 [N/rad] of the mudline, `embedded-pile`, (3,)."""
        stiffness, _ = self.matrices
        below = stiffness[:-2, MUDLINE]
        at_mudline = stiffness[MUDLINE, MUDLINE] - below.T @ solve(stiffness[:-2, :-2], below)
        return np.array([at_mudline[0, 0], at_mudline[1, 1], -at_mudline[0, 1]])


def modes_on(
    pile: Pile, structure: Structure, highest_frequency: float = HIGHEST_FREQUENCY
) -> Modes:
    """Solve for the modes of a structure on a pile, which moves too.

    Its own free ends at depth are part of the solution; `Modes.vectors` is the structure's part.
    """
    own_stiffness, own_mass = pile.matrices
    inner = len(own_mass) - 2
    size = len(structure.mass)
    stiffness, mass = (
        block_diag(each, np.zeros((2 * inner, 2 * inner)))
        for each in (structure.stiffness, structure.mass)
    )
    for number, ((v, positive), (slope, turn)) in enumerate(PLANES):
        below = size + inner * number + np.arange(inner)
        where = np.concatenate([below, [v, slope]])
        signs = np.concatenate([np.ones(inner), [positive, turn]])
        turned = np.outer(signs, signs)
        stiffness[np.ix_(where, where)] += turned * own_stiffness
        mass[np.ix_(where, where)] += turned * own_mass
    basis = block_diag(structure.basis.toarray(), np.eye(2 * inner))
    flexibilities, found = eigh(
        basis.T @ mass @ basis,
        basis.T @ stiffness @ basis,
        subset_by_value=((2 * np.pi * highest_frequency) ** -2, np.inf),
        driver="gvx",
    )
    omega = flexibilities[::-1] ** -0.5
    return Modes(structure, omega / (2 * np.pi), (basis @ (found[:, ::-1] * omega))[:size])
