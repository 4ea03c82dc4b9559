"""What the updating needs to know of the structure: modes at the sensors for many stiffnesses."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray


class ModesOfStiffness(Protocol):
    """Modes of n stiffness triples, m modes each, as the accelerometers read them."""

    @property
    def frequencies(self) -> FloatArray:
        """(n, m) [Hz]; NaN where not admissible."""
        ...

    @property
    def shapes(self) -> FloatArray:
        """(n, m, n_channels) [-], scale arbitrary, channel order of the layout."""
        ...

    @property
    def admissible(self) -> NDArray[np.bool_]:
        """(n,) springs positive definite and structure stable under gravity."""
        ...


class ForwardModel(Protocol):
    """The structure as a function of its foundation, such as `dynamics.modal_model.ModalModel`."""

    @property
    def nominal(self) -> FloatArray:
        """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad] of the turbine's description."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the m modes, the same for every stiffness."""
        ...

    @property
    def water_level(self) -> float:
        """Level of the water that the model stands in, above mean [m]; 0 on land."""
        ...

    def modal(self, theta: FloatArray) -> ModesOfStiffness:
        """Modes for theta, (n, 3) in the units of `nominal`."""
        ...

    def subset(self, labels: Sequence[str]) -> "ForwardModel":
        """A cheaper model with these modes only, in this order."""
        ...

    def following(self, theta_reference: FloatArray) -> "ForwardModel":
        """The same modes, followed by overlap from theta_reference, (3,), instead of nominal."""
        ...

    def with_water_risen(self, rise: float) -> "ForwardModel":
        """The same modes of the same structure with the water higher by so much [m]."""
        ...

    def in_water(self, rises: Sequence[float]) -> ModesOfStiffness:
        """The modes where they are followed from with the water risen above `water_level`, row by
        row [m]; on land they stay as they are."""
        ...
