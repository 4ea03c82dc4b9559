"""What is thought of a farm beforehand, and how long its chains are."""

from dataclasses import dataclass

import numpy as np

from sensors.errors import InputError


class FarmError(InputError):
    """Turbines that cannot be pooled, or settings with which nothing can."""


@dataclass(frozen=True, slots=True)
class PopulationPrior:
    """What is thought of a farm before its first measurement, in natural logarithms."""

    mean_std: float = 1.0
    """s, of the farm's mean about nominal [-]."""
    spread_scale: float = 0.05
    """A: half of all spreads are thought to lie below .8 A [-]."""
    spread_degrees: float = 2.0
    """ν: of the half-t prior of the spread τ."""
    alike: float = 10.0
    """Degrees of freedom that hold the three springs to one spread τ."""
    outlier_std: float = 0.1
    """√W, of an outlier about what it should be: scour takes a tenth [-]."""
    regular_change: float = 0.02
    """By what one like the others may change while it is watched [-]."""
    other_causes: float = 0.1
    """Share of recorded changes that are not the foundation's [-]."""
    outliers: float = 1.0
    """α, as if so many turbines had been seen to be outliers …"""
    regular: float = 19.0
    """β, … and so many not to be: one in twenty."""

    def __post_init__(self) -> None:
        for name in (
            "mean_std",
            "spread_scale",
            "spread_degrees",
            "outlier_std",
            "regular_change",
            "other_causes",
            "outliers",
            "alike",
        ):
            if not 0 < getattr(self, name) < np.inf:
                raise FarmError(f"population {name} is {getattr(self, name)}; it must be positive")
        if not 0 < self.regular < np.inf:
            raise FarmError(f"population regular is {self.regular}; it must be positive")


@dataclass(frozen=True, slots=True)
class GibbsSettings:
    """How long the chains are."""

    chains: int = 12
    burn_in: int = 150
    """Sweeps that are thrown away."""
    sweeps: int = 400
    """That are kept, of each chain."""
    rounds: int = 3
    """At most; each has twice the sweeps of the one before, which it throws away."""
    rhat: float = 1.05
    """Split R̂ beyond which there is another round."""

    def __post_init__(self) -> None:
        if self.chains < 2 or self.sweeps < 10 or self.burn_in < 0 or self.rounds < 1:
            raise FarmError(
                f"{self.chains} chains of {self.burn_in} + {self.sweeps} sweeps, {self.rounds} "
                "rounds; at least 2 of 0 + 10, 1 round, are needed"
            )
