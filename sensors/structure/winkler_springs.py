"""A pile in soil as a beam on Winkler springs: what scour takes from the mudline's stiffness.

    EI v'''' + n_h (ζ − s) v = 0,   ζ: depth below the mudline, s: depth of scour

The soil's stiffness per metre of pile grows with the depth below its surface, as sand's does; above
the scoured surface the pile stands free. Condensed to the mudline this gives k11, k22 and k12. Only
ratios to the unscoured pile are used: how stiff the soil is follows from the description's own k11.

Sources: Reese and Matlock (1956), Proc. 8th Texas Conf. on Soil Mechanics (stiffness proportional
to depth); Hetényi (1946), Beams on Elastic Foundation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from sensors.arrays import FloatArray
from sensors.structure.beam import bending_stiffness, hermite
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import TurbineError

ELEMENTS = 90  # of the pile
DEEPEST = 0.6  # scour that the model is asked for, share of the embedded length [-]
SOILS = (1e3, 1e12)  # n_h within which the described k11 is looked for [N/m³]
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact for the cubics and a line


@dataclass(frozen=True, slots=True)
class PileInSoil:
    """A uniform pile below the mudline in soil whose stiffness grows with depth."""

    length: float
    """Embedded length [m]."""

    bending_rigidity: float
    """EI [N·m²]."""

    soil_gradient: float
    """n_h [N/m³]."""

    @classmethod
    def of(cls, description: TurbineDescription) -> "PileInSoil":
        """Return the pile below the lowest tube, in a soil that makes the described k11.

        Returns
        -------
        PileInSoil

        Raises
        ------
        TurbineError
            If the description has no embedded length, or no soil does.
        """
        foundation = description.foundation
        if not foundation.embedded_length > 0:
            raise TurbineError(
                f"{description.name}: scour needs the pile's embedded_length [m] in [foundation]"
            )
        rigidity = description.tubes[0].bending_rigidity

        def excess(log_gradient: float) -> float:
            pile = cls(foundation.embedded_length, rigidity, float(np.exp(log_gradient)))
            return float(np.log(pile.springs(0.0)[0] / foundation.k11))

        softest, hardest = np.log(SOILS)
        if excess(softest) > 0 or excess(hardest) < 0:
            raise TurbineError(
                f"{description.name}: no soil holds a pile of {foundation.embedded_length:g} m "
                f"with k11 = {foundation.k11:g} N/m"
            )
        gradient = float(np.exp(brentq(excess, softest, hardest)))
        return cls(foundation.embedded_length, rigidity, gradient)

    def springs(self, scour: float) -> FloatArray:
        """k11 [N/m], k22 [N·m/rad] and the magnitude of k12 [N/rad] at the mudline, (3,).

        Parameters
        ----------
        scour : float
            Depth of the soil that has gone [m].

        Returns
        -------
        ndarray, shape (3,)
        """
        stiffness = self._stiffness(scour)
        below = stiffness[2:, 2:]
        coupling = stiffness[2:, :2]
        mudline = stiffness[:2, :2] - coupling.T @ np.linalg.solve(below, coupling)
        return np.array([mudline[0, 0], mudline[1, 1], abs(mudline[0, 1])])

    def scoured(self, depths: ArrayLike) -> FloatArray:
        """Return k11, k22 and k12 as shares of the unscoured pile's, (n, 3) for (n,) depths [m].

        Between a few dozen depths they are interpolated.

        Depths beyond DEEPEST of the embedded length count as that.
        """
        nodes = np.linspace(0.0, DEEPEST * self.length, 55)
        shares = np.array([self.springs(depth) for depth in nodes]) / self.springs(0.0)
        wanted = np.asarray(depths, dtype=np.float64)
        columns = [np.exp(np.interp(wanted, nodes, np.log(share))) for share in shares.T]
        return np.stack(columns, axis=-1)

    def _stiffness(self, scour: float) -> FloatArray:
        """Of (v, ψ) of every node from the mudline down, the soil's added."""
        step = self.length / ELEMENTS
        beam = bending_stiffness(self.bending_rigidity, step)
        xi, weights = (_POINTS + 1) / 2, _WEIGHTS / 2
        shapes = hermite(xi, step)
        total = np.zeros((2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
        for number in range(ELEMENTS):
            soil = self.soil_gradient * np.maximum((number + xi) * step - scour, 0.0)
            rows = slice(2 * number, 2 * number + 4)
            total[rows, rows] += beam + step * (shapes.T * (weights * soil)) @ shapes
        return total
