"""The foundation at the mudline: coupled springs, and the two sign conventions of k12.

In each vertical plane the displacement v and the slope ψ = +dv/dz (z up) of the mudline are held
by

    (F, M) = [[k11, k12], [k12, k22]] (v, ψ)                          [foundation-updating] Eq. 12

The paper gives one unit, N/m, for all entries; they are k11 [N/m], k12 [N/rad = N·m/m] and
k22 [N·m/rad]. It prints k12 as positive. Taken literally in the axes above (`published`), that is
a translational spring k11 at the height k12/k11 *above* the mudline and a rotational spring
k22 − k12²/k11; this is what reproduces the paper's Table 1. An embedded pile pushed sideways turns
the other way: with z up its coupling is −k12 (`embedded-pile`), the spring below the mudline. The
magnitude k12 is positive in both; the convention decides the sign with which it enters.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensors.arrays import FloatArray
from sensors.errors import InputError

SpringSign = Literal["published", "embedded-pile"]
MOST_MOVING_MASS = 1e6  # a pile of 20 m, full of soil [kg/m]
PILE_SHAPES = (
    (0.5, 1.06066, 0.5, 0.353553),
    (0.57395, 0.92171, 0.36616, 0.20975),
    (0.61805, 0.84664, 0.30186, 0.15133),
    (0.64671, 0.79993, 0.26481, 0.12103),
    (0.66670, 0.76841, 0.24098, 0.10299),
)
"""Of piles on beds of springs that grow with the depth to the power 0, ½, 1, 1½ and 2:
k12² / (k11 k22), then M11 / mℓ, |M12| / mℓ² and M22 / mℓ³ [-]. The first is the closed form of the
semi-infinite beam on an even bed, (½, 3√2/4, ½, √2/4), by the deflections of M. Hetényi, "Beams on
Elastic Foundation", 1946; the others are by finite elements."""
SPRING_SIGNS: tuple[SpringSign, ...] = get_args(SpringSign)


class TurbineError(InputError):
    """A turbine description that cannot be right; the message names the file, section and key."""


@dataclass(frozen=True, slots=True)
class FoundationSprings:
    """Coupled springs of the mudline, the same in every vertical plane."""

    k11: float
    """Translational stiffness at the mudline, the lower end of the lowest tube [N/m]."""

    k22: float
    """Rotational stiffness [N·m/rad]."""

    k12: float
    """Magnitude of the coupling stiffness [N/rad]."""

    sign: SpringSign = "published"
    """"published": +k12 on (v, +dv/dz); "embedded-pile": −k12."""
    embedded_length: float = 0.0
    """Embedded length of the pile below the mudline; 0: unknown [m]."""
    moving_mass: float | None = None
    """Mass of the pile, and of the soil that moves with it, per metre below the mudline [kg/m];
    None: not stated, and calculated as none."""

    def __post_init__(self) -> None:
        if not self.embedded_length >= 0:
            raise TurbineError(
                f"foundation: embedded_length is {self.embedded_length:g} m; it must be positive"
            )
        if self.moving_mass is not None and not 0 <= self.moving_mass < MOST_MOVING_MASS:
            raise TurbineError(
                f"foundation: moving_mass is {self.moving_mass:g} kg/m; a pile and the soil in it "
                f"have up to {MOST_MOVING_MASS:g} kg/m"
            )
        if self.sign not in SPRING_SIGNS:
            raise TurbineError(
                f"foundation: sign {self.sign!r} is neither 'published' nor 'embedded-pile'"
            )
        if self.k12 < 0:
            raise TurbineError(
                f"foundation: k12 is {self.k12:g} N/rad; its magnitude is needed, the sign "
                "convention states how it enters"
            )
        if not bool(positive_definite(self.stiffness)):
            raise TurbineError(
                f"foundation: k11 = {self.k11:g} N/m, k22 = {self.k22:g} N·m/rad, "
                f"k12 = {self.k12:g} N/rad is not positive definite; it needs k11 > 0, k22 > 0 "
                f"and k12 < sqrt(k11·k22) = {np.sqrt(max(self.k11 * self.k22, 0.0)):g} N/rad"
            )

    @property
    def stiffness(self) -> FloatArray:
        """θ = (k11, k22, k12), (3,) [N/m, N·m/rad, N/rad]."""
        return np.array([self.k11, self.k22, self.k12])

    @property
    def mass(self) -> FloatArray:
        """Mass that the mudline moves below it, of (v, ψ) in one plane, (2, 2) [kg, kg·m, kg·m²].

        Notes
        -----
        That of a long pile which follows the mudline as at rest, on a bed of springs that grows
        with a power of the depth (`PILE_SHAPES`). Which one is read off k12² / (k11 k22), with
        ℓ² = k22 / k11, of the springs as described: it stays where the posterior's are others.
        """
        length = np.sqrt(self.k22 / self.k11)
        coupling = self.k12**2 / (self.k11 * self.k22)
        by_coupling, *columns = np.transpose(PILE_SHAPES)
        m11, m12, m22 = (float(np.interp(coupling, by_coupling, column)) for column in columns)
        m12 *= length**2 * (1 if self.sign == "published" else -1)
        shape = np.array([[m11 * length, m12], [m12, m22 * length**3]])
        return np.asarray((self.moving_mass or 0.0) * shape)


def positive_definite(theta: ArrayLike) -> NDArray[np.bool_]:
    """Return whether springs can hold a structure at all: k11 > 0, k22 > 0 and k11 k22 > k12².

    Parameters
    ----------
    theta : ArrayLike, shape (..., 3)
        θ = (k11, k22, k12) [N/m, N·m/rad, N/rad].

    Returns
    -------
    ndarray, shape (...,)
        False where θ is not finite.
    """
    theta = np.asarray(theta, dtype=np.float64)
    k11, k22, k12 = np.moveaxis(theta, -1, 0)
    finite = np.isfinite(theta).all(axis=-1)
    return finite & (k11 > 0) & (k22 > 0) & (k11 * k22 > k12**2)


def spring_matrix(theta: ArrayLike, sign: SpringSign) -> FloatArray:
    """Stiffness of (v, ψ) of the mudline in one plane.

    Parameters
    ----------
    theta : ArrayLike, shape (..., 3)
        θ = (k11, k22, k12) [N/m, N·m/rad, N/rad].

    Returns
    -------
    ndarray, shape (..., 2, 2)
        Eq. 12 with +k12 (`published`) or −k12 (`embedded-pile`).
    """
    k11, k22, k12 = np.moveaxis(np.asarray(theta, dtype=np.float64), -1, 0)
    coupling = k12 if sign == "published" else -k12
    rows = [np.stack([k11, coupling], axis=-1), np.stack([coupling, k22], axis=-1)]
    return np.stack(rows, axis=-2)
